// What the colours of the shown layer mean.

import { fill, h } from "./dom.js";
import { quantity, sentence } from "./format.js";
import { OUTSIDE, UNEXPLORED, UNREACHABLE } from "./raster.js";
import style from "./style.js";

/** Free floor that is not judged, whatever the reason: the tiles of a service tell no more. */
const NOT_COUNTED = -1;

/** Follow the layer that is shown. */
export function followLegend(element, source, store) {
  let asked = 0;
  store.watch(["map", "layer"], async ({ map, layer }) => {
    if (!map) return;
    const mine = ++asked;
    const [info, about] = layer === "zone" ? [null, await source.map(map.id)] : [await source.layer(map.id, layer)];
    if (mine !== asked) return;
    fill(element, info ? scale(info, map.layers.find(({ name }) => name === layer) ?? info) : zones(about));
  });
}

function zones({ classes, figures }) {
  const left = figures && figures.free_area_m2 - figures.judged_area_m2 > 0.005 * figures.free_area_m2;
  const shown = classes ?? (left ? [NOT_COUNTED] : []);
  const others = [
    [NOT_COUNTED, "Not counted", style.unreachable],
    [UNEXPLORED, "Unexplored", `repeating-linear-gradient(135deg, ${style.unknown} 0 3px, ${style.unexplored} 3px 6px)`],
    [UNREACHABLE, "Out of reach", style.unreachable],
    [OUTSIDE, "Outside", style.unknown],
  ];
  const entry = (name, background, meaning) =>
    h("li", { title: meaning }, h("span", { class: "swatch", style: { background } }), name);
  return h("ul", { class: "swatches" },
    style.zones.map(({ name, colour, meaning }) => entry(sentence(name), colour, sentence(meaning))),
    others.filter(([code]) => shown.includes(code)).map(([, name, ink]) => entry(name, ink, null)));
}

function scale({ min, max, colours, legend, log }, { long_name: name, units, worse }) {
  const stops = colours ?? legend.map(({ colour }) => colour);
  const ends = { high: ["well localized", "badly localized"], low: ["badly localized", "well localized"] }[worse] ?? ["", ""];
  const isAxis = units === "rad" && !worse;
  const shown = (value) => (isAxis ? `${Math.round((value * 180) / Math.PI)}°` : quantity(value, units));
  return [
    h("p", { class: "legend-name" }, sentence(name), units && units !== "1" && !isAxis ? ` (${units})` : ""),
    h("div", { class: "ramp", style: { background: `linear-gradient(to right, ${stops.join(", ")})` } }),
    h("div", { class: "ends" }, h("span", {}, shown(min)), log && h("span", { class: "soft" }, "powers of ten"), h("span", {}, shown(max))),
    ends[0] && h("div", { class: "ends soft" }, h("span", {}, ends[0]), h("span", {}, ends[1])),
  ];
}
