// The panel of edits: tools, what they changed, the obstacles as a list and by their numbers.

import { fill, h, saySeconds, svg } from "./dom.js";
import { EditForm } from "./edit_form.js";
import { area, sentence } from "./format.js";
import { collectionOf, KINDS, obstaclesOf, text } from "./obstacles.js";
import style from "./style.js";

const ICONS = {
  move: "M12 3v18M3 12h18M9 6l3-3 3 3M9 18l3 3 3-3M6 9l-3 3 3 3M18 9l3 3-3 3",
  wall: "M4 20 20 4",
  panel: "M6 18 18 6M4 16l4 4M16 4l4 4",
  post: "M12 7a5 5 0 1 0 0 10 5 5 0 0 0 0-10Z",
  reflector: "M5 19 15 9M15 9l5-1M15 9l1-5M17 7l4-4",
};
const HINTS = {
  move: "Drag an obstacle, or a chosen one by its corners.",
  wall: "Press on the floor, pull and let go.",
  panel: "Press on the floor, pull and let go: a wall without thickness.",
  post: "Press where the post stands; pull to move it before you let go.",
  reflector: "Pull for a strip, or click for a post, that reflects.",
};

export class EditPanel {
  #end = () => {};

  constructor(element, store, obstacles, source) {
    Object.assign(this, { element, store, obstacles, source });
    this.said = h("p", { class: "message", role: "status" });
    this.outcome = h("div", { class: "outcome", "aria-live": "polite" });
    this.list = h("ol", { class: "obstacles" });
    this.#build();
    store.watch(["tool"], ({ tool }) => this.#tools(tool));
    store.watch(["obstacles", "picked"], () => this.#list());
    store.watch(["edited", "original"], () => this.#outcome());
    store.watch(["working", "trouble", "tool"], () => this.#status());
  }

  /** Say something until the next thing happens. */
  say(message) {
    this.said.textContent = message;
    this.said.classList.remove("error");
  }

  #build() {
    const { store, obstacles } = this;
    const tool = (name, title) => h("button", { "aria-pressed": "false", "data-tool": name, onclick: () => store.set({ tool: name }) },
      svg("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, svg("path", { d: ICONS[name] })), title);
    this.toolButtons = [tool("move", "Move"), ...Object.entries(KINDS).map(([name, { title }]) => tool(name, title))];
    this.undoButton = h("button", { onclick: () => obstacles.undo(), title: "Ctrl+Z" }, "Undo");
    this.redoButton = h("button", { onclick: () => obstacles.redo(), title: "Ctrl+Y" }, "Redo");
    this.steps = h("ol", { class: "steps" });
    this.deleteButton = h("button", { onclick: () => obstacles.remove(store.get("picked")) }, "Delete");
    this.resetButton = h("button", { onclick: () => obstacles.replace([]) }, "Reset");
    this.originalButton = h("button", { "aria-pressed": "false", "aria-label": "Show the original", onclick: () => store.set({ original: !store.get("original") }) }, "Original");
    this.saveButton = h("button", { onclick: () => save("obstacles.geojson", JSON.stringify(collectionOf(obstacles.list), null, 1)) }, "Save the obstacles");
    this.buildingButton = h("button", { onclick: () => this.#building() }, "Save the building");
    const file = h("input", { type: "file", accept: ".geojson,.json,application/geo+json", "aria-label": "File of obstacles", onchange: () => this.#open(file) });
    const form = h("fieldset", { class: "numbers" });
    fill(this.element,
      h("p", { class: "soft" }, "Draw what might help, and the map around it follows. The map that is served stays what it is."),
      h("div", { class: "tools", role: "toolbar", "aria-label": "Tools" }, this.toolButtons),
      this.said,
      h("div", { class: "buttons" }, this.undoButton, this.redoButton, this.deleteButton, this.resetButton, this.originalButton),
      this.outcome, this.list, form,
      h("details", {}, h("summary", {}, "Changes"), h("p", { class: "soft" }, "The last one first; click one to undo it and all after it."), this.steps),
      h("fieldset", {}, h("legend", {}, "Files"), h("div", { class: "buttons" }, this.saveButton, this.buildingButton),
        h("label", { class: "open-file" }, "Open obstacles", file)));
    this.form = new EditForm(form, store, obstacles);
  }

  #tools(tool) {
    for (const button of this.toolButtons) button.setAttribute("aria-pressed", String(button.dataset.tool === tool));
  }

  #status() {
    const { working, trouble, tool } = this.store.values;
    this.#end();
    if (working && !trouble) this.#end = saySeconds(this.said, "Working out the map …");
    else this.said.textContent = trouble ?? HINTS[tool];
    this.said.classList.toggle("error", Boolean(trouble));
    this.element.toggleAttribute("aria-busy", Boolean(working));
  }

  #list() {
    const { obstacles, picked } = this.store.values;
    this.undoButton.disabled = !this.obstacles.canUndo;
    this.redoButton.disabled = !this.obstacles.canRedo;
    fill(this.steps, this.obstacles.steps.map((name, i) => h("li", {}, h("button", { onclick: () => this.obstacles.undo(i + 1) }, name))));
    this.deleteButton.disabled = picked === null;
    this.resetButton.disabled = this.saveButton.disabled = !obstacles.length;
    fill(this.list, obstacles.map((one, i) => h("li", {},
      h("button", { class: "obstacle-entry", "aria-pressed": String(i === picked), onclick: () => this.store.set({ picked: i === picked ? null : i, tool: "move" }) },
        h("span", { class: "badge obstacle" }, String(i + 1)), h("span", {}, text(one))),
      h("button", { class: "close", "aria-label": `Delete obstacle ${i + 1}`, onclick: () => this.obstacles.remove(i) }, "×"))));
  }

  #outcome() {
    const { edited, original } = this.store.values;
    this.originalButton.disabled = !edited;
    this.originalButton.setAttribute("aria-pressed", String(Boolean(original)));
    this.buildingButton.disabled = !edited;
    if (!edited) {
      fill(this.outcome);
      return;
    }
    const { zones, bad_before_m2: before, bad_after_m2: after } = edited;
    const share = before > 0 ? ` (${signed((100 * (after - before)) / before, 0)} %)` : "";
    const row = (name, swatch, from, to) => h("tr", {}, h("th", { scope: "row" }, swatch, name), h("td", {}, plain(from)), h("td", {}, plain(to)), h("td", {}, signed(to - from, 1)));
    fill(this.outcome,
      h("p", { class: "gain", "data-before": before, "data-after": after }, "Bad floor ", area(before), " → ", h("b", {}, area(after)), share),
      h("table", {}, h("caption", {}, "Explored floor, m²; corridor and open are bad"),
        h("thead", {}, h("tr", {}, ["Zone", "Before", "Now", "Change"].map((title) => h("th", { scope: "col" }, title)))),
        h("tbody", {}, zones.map(({ zone, before_m2: from, after_m2: to }) => row(sentence(zone),
          h("span", { class: "swatch", style: { background: style.zones.find(({ name }) => name === zone)?.colour } }), from, to)))));
  }

  async #building() {
    try {
      save("building.geojson", JSON.stringify(await this.source.building(this.store.get("edited").id)));
    } catch (problem) {
      this.store.set({ trouble: problem.message });
    }
  }

  async #open(file) {
    const [chosen] = file.files;
    if (!chosen) return;
    try {
      this.obstacles.replace(obstaclesOf(JSON.parse(await chosen.text())));
    } catch (problem) {
      this.store.set({ trouble: problem instanceof SyntaxError ? `${chosen.name} is not JSON.` : problem.message });
    }
    file.value = "";
  }
}

const plain = (value) => area(value).replace(/\u00a0m²$/, "");

function signed(value, digits) {
  const shown = Math.abs(value).toFixed(digits);
  return Number(shown) === 0 ? shown : `${value > 0 ? "+" : "−"}${shown}`;
}

/** Offer a text as a file. */
function save(name, content) {
  const address = URL.createObjectURL(new Blob([content], { type: "application/geo+json" }));
  h("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}
