// The values at a point: under the pointer, where the map was clicked, or in its middle.

import { eachFrame, fill, h } from "./dom.js";
import { metres, number, quantity, sentence, title } from "./format.js";
import { Probe } from "./overlays.js";
import style from "./style.js";

const FIRST = ["level", "major_radius", "minor_radius", "clearance"];
const NAMES = {
  level: "Ambiguity level",
  major_radius: "Slides unseen along",
  minor_radius: "Slides unseen across",
  clearance: "Nearest wall",
};
const REASONS = { outside: "Outside the map", wall: "In a wall or obstacle", unknown: "Unknown space" };

export class Readout {
  #busy = false;
  #next = null;
  #shown = null;

  constructor(element, floor, source, store) {
    Object.assign(this, { element, floor, source, store });
    this.probe = new Probe(floor);
    const read = eachFrame(() => this.#read());
    store.watch(["probe", "pinned", "theta", "heading", "weight", "overlays", "layer", "theme", "version", "other"], read);
  }

  /** A map was opened: follow its pointer. */
  opened(map) {
    this.map = map;
    const { leaflet } = this.floor;
    const follow = eachFrame((event) => {
      const { pinned, dragging, tab, tool } = this.store.values;
      const drawing = dragging || (tab === "edit" && tool !== "move");
      if (!pinned && !drawing) this.store.set({ probe: { x: event.latlng.lng, y: event.latlng.lat } });
    });
    leaflet.on("mousemove", follow);
    leaflet.on("mouseout", () => {
      if (!this.store.get("pinned")) this.store.set({ probe: null });
    });
    this.store.set({ probe: null, pinned: false });
    this.#rest();
  }

  /** Read the values at the probe; one question at a time, the latest of those that wait. */
  async #read() {
    if (this.#busy) {
      this.#next = true;
      return;
    }
    this.#busy = true;
    do {
      this.#next = null;
      await this.#ask();
    } while (this.#next);
    this.#busy = false;
  }

  async #ask() {
    const { probe, pinned, theta, heading, weight, overlays } = this.store.values;
    if (!this.map || !probe) {
      this.#rest();
      return;
    }
    const id = this.floor.idAt(probe);
    const version = this.floor.shown;
    const turned = this.map.headings > 1;
    try {
      const at = typeof heading === "number" ? heading : null;
      const [answer, scan] = await Promise.all([
        this.source.values(id, probe.x, probe.y, at, weight),
        overlays.scan ? this.source.scan(id, probe.x, probe.y, at ?? theta) : null,
      ]);
      if (this.floor.shown !== version || this.store.get("probe") === null) return;
      this.probe.draw(probe, scan?.x.length && !answer.reason ? scan : null, pinned, turned ? (at ?? theta) : null);
      this.#show(probe, answer, scan, pinned);
    } catch (problem) {
      fill(this.element, h("p", { class: "soft" }, problem.message));
    }
  }

  #rest() {
    this.probe.clear();
    this.#shown = null;
    delete this.element.dataset.x;
    this.element.classList.add("resting");
    const touch = matchMedia("(hover: none)").matches;
    fill(this.element, h("p", { class: "hint" }, touch ? "Tap the floor to read its values." : "Point at the floor to read its values; click to hold them."));
  }

  #show({ x, y }, answer, scan, pinned) {
    this.element.classList.remove("resting");
    Object.assign(this.element.dataset, { x, y });
    this.#shown = answer;
    const where = h("span", { class: "where" }, `x ${number(x)}, y ${number(y)} m`);
    const close = pinned && h("button", { class: "close", "aria-label": "Let go of this point", onclick: () => this.store.set({ pinned: false, probe: null }) }, "×");
    if (answer.reason) {
      fill(this.element, h("header", {}, h("strong", {}, REASONS[answer.reason] ?? answer.reason), close), where);
      return;
    }
    const zone = style.zones.find(({ name }) => name === answer.zone);
    const head = zone
      ? h("strong", {}, h("span", { class: "swatch", style: { background: zone.colour } }), sentence(zone.name))
      : h("strong", {}, sentence(answer.remark ?? "free floor"));
    fill(
      this.element,
      h("header", {}, head, close),
      h("dl", {}, this.#rows(answer).map(([name, text, key]) => [h("dt", {}, name), h("dd", { "data-layer": key, "data-value": key === "cost" ? answer.cost : answer.values[key] }, text)])),
      scan && h("p", { class: "soft" }, scanText(scan)),
      where,
    );
  }

  #rows({ values, cost }) {
    const units = Object.fromEntries(this.map.layers.map((layer) => [layer.name, layer.units]));
    const layer = this.store.get("layer");
    const names = FIRST.includes(layer) || layer === "zone" ? FIRST : [...FIRST, layer];
    const rows = names
      .filter((name) => values[name] !== undefined)
      .map((name) => [NAMES[name] ?? title(name), units[name] === "m" ? metres(values[name], 2) : quantity(values[name], units[name]), name]);
    if (typeof cost === "number") rows.push([`Cost at weight ${this.store.get("weight")}`, `${number(cost)} m/m`, "cost"]);
    return rows;
  }
}

function scanText({ hit }) {
  const silent = hit.filter((echo) => !echo).length;
  return silent ? `${silent} of ${hit.length} beams without echo` : `All ${hit.length} beams return an echo`;
}
