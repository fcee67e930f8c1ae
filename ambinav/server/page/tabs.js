// Tabs over panels, as the ARIA practices have them: arrows move, one tab stop.

import { fill, h } from "./dom.js";

/**
 * @param tabs [id, title, panel element] each.
 * @returns show(id).
 */
export function makeTabs(bar, tabs, store) {
  const buttons = tabs.map(([id, title, panel]) => {
    Object.assign(panel, { id: `panel-${id}` });
    panel.setAttribute("role", "tabpanel");
    panel.setAttribute("aria-labelledby", `tab-${id}`);
    panel.tabIndex = 0;
    return h("button", { role: "tab", id: `tab-${id}`, "aria-controls": `panel-${id}`, onclick: () => store.set({ tab: id }) }, title);
  });
  bar.setAttribute("role", "tablist");
  fill(bar, buttons);
  bar.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const at = buttons.indexOf(document.activeElement);
    const next = buttons[(at + step + buttons.length) % buttons.length];
    next.focus();
    next.click();
    event.preventDefault();
  });
  store.watch(["tab"], ({ tab }) => {
    tabs.forEach(([id, , panel], i) => {
      const chosen = id === tab;
      panel.hidden = !chosen;
      buttons[i].setAttribute("aria-selected", String(chosen));
      buttons[i].tabIndex = chosen ? 0 : -1;
    });
  });
}
