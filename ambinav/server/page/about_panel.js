// What the map is of: parameters with units and a sentence each, and the keys.

import { fill, h } from "./dom.js";
import { area, sentence } from "./format.js";
import { EDIT_KEYS, KEYS, PLAN_KEYS } from "./keys.js";
import style from "./style.js";

/** Build the panel from what the service says of a map. */
export function aboutPanel(element, map, can) {
  fill(element,
    h("h2", {}, "Zones"),
    h("dl", { class: "zones" }, style.zones.map(({ name, colour, meaning }) => {
      const found = (map.zones ?? []).find((zone) => (zone.zone ?? zone.name) === name);
      const size = found && [`${Math.round(100 * found.share)} %`, area(found.area_m2)].join(", ");
      return [h("dt", {}, h("span", { class: "swatch", style: { background: colour } }), sentence(name), size && h("span", { class: "soft" }, ` ${size}`)), h("dd", {}, `${sentence(meaning)}.`)];
    })),
    floor(map),
    parameters(map),
    h("h2", {}, "Keys, while the map has the focus"),
    h("dl", { class: "keys" }, [...KEYS, ...(can.plan ? PLAN_KEYS : []), ...(can.edit ? EDIT_KEYS : [])].map(([key, text]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, text)])));
}

/** What of the free floor counts, and why the rest does not. */
function floor({ figures }) {
  if (!figures) return null;
  const radius = `${Number(figures.robot_radius_m.toFixed(3))} m`;
  const rows = [
    ["Counted", figures.judged_area_m2, `Explored, and reached by a robot of radius ${radius}: what all figures are of.`],
    ["Unexplored", figures.unexplored_area_m2, "Half of the beams or more end in unknown space."],
    ["Too close to walls", figures.too_close_area_m2, `Not counted: no room for a robot of radius ${radius}.`],
    ["Not reachable", figures.not_reachable_area_m2, "Not counted: the robot would fit, but cannot get there."],
    ["Outside", figures.outside_area_m2, "Not counted: the margin around the building, or where the map ends."],
  ];
  return [
    h("h2", {}, "Floor"),
    h("dl", { class: "parameters" }, rows.filter(([, size], i) => !i || size > 0).map(([name, size, meaning]) => [
      h("dt", {}, name, h("b", {}, area(size))),
      h("dd", {}, meaning),
    ])),
  ];
}

function parameters({ attrs }) {
  if (!attrs) return null;
  return [
    h("h2", {}, "Parameters"),
    h("dl", { class: "parameters" }, Object.entries(attrs).map(([name, { value, unit, text: meaning }]) => [
      h("dt", {}, sentence(name.replaceAll("_", " ")), h("b", {}, `${text(value)}${unit && unit !== "1" ? ` ${unit}` : ""}`)),
      h("dd", {}, meaning),
    ])),
  ];
}

function text(value) {
  if (value === null) return "none";
  if (typeof value === "number") return String(Number(value.toPrecision(4)));
  return String(value);
}
