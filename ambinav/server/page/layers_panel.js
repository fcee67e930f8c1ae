// Which layer is shown, at which heading, and what lies over it.

import { fill, h } from "./dom.js";
import { degrees, sentence, title } from "./format.js";

const FIRST = ["zone", "level", "major_radius", "minor_radius"];
const TITLES = { zone: "Zones", level: "Ambiguity level", major_radius: "Slides unseen along", minor_radius: "Slides unseen across" };
const TEXTS = {
  zone: "Four kinds of floor, from well localized to lost",
  level: "0: every move changes the scan; 1: none does",
  major_radius: "How far the robot can move along the weak direction without noticing",
  minor_radius: "How far it can move across that direction",
};
const OVERLAYS = [
  ["walls", "Walls"],
  ["direction", "Weak direction"],
  ["scan", "Expected scan at the pointer"],
  ["places", "Worst places"],
];
// Said by other means, or no quantity of the floor.
const HIDDEN = new Set(["free", "judged", "best_heading"]);

/** Build the panel into an element and follow the store. */
export function layersPanel(element, store, can) {
  store.watch(["map"], ({ map }) => map && fill(element, layerList(map, store), headings(map, store), overlays(store, map), can.stat && summary(store)));
  store.watch(["layer", "map"], ({ layer }) => {
    const radio = element.querySelector(`input[name=layer][value="${CSS.escape(layer ?? "")}"]`);
    if (radio) radio.checked = true;
    const further = radio?.closest("details");
    if (further) further.open = true;
  });
  store.watch(["heading", "theta", "map"], ({ heading, theta }) => {
    const slider = element.querySelector("input[type=range]");
    if (!slider) return;
    const radio = element.querySelector(`input[name=heading][value=${typeof heading === "number" ? "one" : "mean"}]`);
    if (radio) radio.checked = true;
    slider.value = Math.round((theta * 180) / Math.PI);
    slider.nextElementSibling.textContent = degrees(theta);
  });
}

function layerList(map, store) {
  const base = map.layers.filter(({ name }) => !HIDDEN.has(name) && !/_(mean|best|worst)$/.test(name));
  const first = FIRST.map((name) => base.find((layer) => layer.name === name)).filter(Boolean);
  const rest = base.filter((layer) => !FIRST.includes(layer.name));
  const choice = ({ name, long_name: text, units }) =>
    h("label", { class: "choice" },
      h("input", { type: "radio", name: "layer", value: name, onchange: () => store.set({ layer: name }) }),
      h("span", {}, h("b", {}, TITLES[name] ?? title(name), units && !["1", "", "code", "bool"].includes(units) && h("i", {}, ` ${units === "rad" ? "degrees" : units}`)),
        h("small", {}, TEXTS[name] ?? sentence(text))));
  return h("fieldset", {}, h("legend", {}, "Layer"), first.map(choice),
    rest.length > 0 && h("details", {}, h("summary", {}, `${rest.length} more layers`), rest.map(choice)));
}

function headings(map, store) {
  if (!(map.headings > 1)) return null;
  const slider = h("input", { type: "range", min: 0, max: 359, step: 1, value: 0, "aria-label": "Heading of the robot, degrees",
    oninput: () => turn(Number(slider.value)) });
  const radios = [["mean", "Mean over all headings"], ["one", "One heading"]].map(([value, text]) =>
    h("label", { class: "line" }, h("input", { type: "radio", name: "heading", value,
      onchange: () => turn(Number(slider.value)) }), h("span", {}, text)));
  const turn = (angle) => {
    const theta = (angle * Math.PI) / 180;
    const one = !map.fixed_heading && radios[1].firstChild.checked;
    store.set({ theta, heading: one ? theta : "mean" });
  };
  return h("fieldset", {}, h("legend", {}, "Robot's heading"), !map.fixed_heading && radios, h("div", { class: "slider" }, slider, h("output", {})),
    h("p", { class: "soft" }, "The scanner does not look all around. The expected scan is drawn at this heading, counter-clockwise from x."));
}

function summary(store) {
  return h("fieldset", {}, h("legend", {}, "Zoomed out"),
    h("label", { class: "line" }, h("input", { type: "checkbox", name: "worst", checked: store.get("stat") === "worst",
      onchange: (event) => store.set({ stat: event.target.checked ? "worst" : "mean" }) }), h("span", {}, "A pixel shows the worst of its cells")));
}

function overlays(store, map) {
  const shown = OVERLAYS.filter(([name]) => name !== "places" || map.has_places !== false);
  return h("fieldset", {}, h("legend", {}, "Over it"), shown.map(([name, text]) =>
    h("label", { class: "line" }, h("input", { type: "checkbox", name, checked: store.get("overlays")[name],
      onchange: (event) => store.set({ overlays: { ...store.get("overlays"), [name]: event.target.checked } }) }), h("span", {}, text))));
}
