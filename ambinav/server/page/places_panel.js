// The worst places as a list; each entry flies to its place.

import { fill, h } from "./dom.js";
import { area, axis, metres, number, sentence } from "./format.js";
import style from "./style.js";

/** Build the list; `places` are as the service gives them. Returns what ends following the store. */
export function placesPanel(element, places, floor, store) {
  if (!places.length) {
    fill(element, h("p", {}, "No place of notable size leaves the robot lost."));
    return () => {};
  }
  const buttons = places.map((place, i) => entry(place, i, store));
  fill(element,
    h("p", { class: "soft" }, "Ranked by ambiguity level times area. Choose one to see it."),
    h("ol", { class: "places" }, buttons.map((button) => h("li", {}, button))));
  return store.watch(["place"], ({ place }) => {
    buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(i === place)));
    if (place === null || place === undefined) return;
    const { x, y, theta, length, area_m2: size } = places[place];
    floor.flyTo(x, y, Math.min(Math.max(0.5 * (length ?? Math.sqrt(size)), 4), 15));
    store.set({ probe: { x, y }, pinned: true, ...(typeof theta === "number" ? { theta } : {}) });
    const panel = element.closest(".panel");
    if (panel?.offsetParent) buttons[place].scrollIntoView({ block: "nearest" });
  });
}

function entry(place, i, store) {
  const zone = style.zones.find(({ name }) => name === place.zone);
  const size = place.length ? `${number(place.length, 1)} × ${metres(place.width)}` : area(place.area_m2);
  return h("button", { class: "place-entry", "aria-pressed": "false", onclick: () => {
    store.set({ place: null });
    store.set({ place: i });
  } },
    h("span", { class: "number", style: { "--zone": zone?.colour ?? "transparent" } }, String(place.number ?? i + 1)),
    h("span", { class: "what" },
      h("b", {}, zone ? `${zone.name[0].toUpperCase()}${zone.name.slice(1)}, ${size}` : size),
      h("small", {}, [
        `level ${number(place.level)}`,
        typeof place.weak_direction === "number" ? `slides along ${axis(place.weak_direction)}` : null,
        `at ${number(place.x, 1)}, ${metres(place.y)}`,
      ].filter(Boolean).join(" · ")),
      place.reason && h("small", { class: "reason" }, sentence(place.reason.replace(`${place.zone}: `, "")))));
}
