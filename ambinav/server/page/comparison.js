// Two maps of one floor side by side; a slider says where one ends and the other begins.

import { fill, h } from "./dom.js";
import { placedTiles, servedTiles } from "./tiles.js";

const STEPS = 1000;
const HAIR = 1e-6;

/** Whether the edges of two maps lie no further apart than so many metres. */
function areBeside(one, other, metres) {
  return one.bounds.every((edge, i) => Math.abs(edge - other.bounds[i]) < metres);
}

export class Comparison {
  #tiles = null;

  /** `stage` is around the map, `place` where the other map is chosen, `maps` all that are served. */
  constructor(stage, place, floor, source, store, maps) {
    Object.assign(this, { stage, place, floor, source, store, maps });
    this.range = h("input", { type: "range", class: "divide", min: 0, max: STEPS, value: STEPS / 2, "aria-label": "Border between both maps", oninput: () => this.#clip() });
    this.line = h("div", { class: "border", "aria-hidden": "true" });
    this.names = [h("p", { class: "side left card" }), h("p", { class: "side right card" })];
    store.watch(["map"], ({ map }) => map && this.#opened(map));
    store.watch(["other", "layer", "heading", "stat", "theme"], () => this.#show());
    new ResizeObserver(() => this.#clip()).observe(stage);
    floor.idAt = ({ x, y }) => (this.#isRight(x, y) ? store.get("other").id : floor.shown);
  }

  /** A map was opened: offer the others of the same floor, to a cell. */
  #opened(map) {
    this.#tiles = null;
    const others = this.maps.filter((one) => one.id !== map.id && areBeside(one, map, Math.max(one.spacing, map.spacing) + HAIR));
    this.floor.leaflet.createPane("other").style.zIndex = 250;
    this.floor.leaflet.on("move zoom viewreset resize", () => this.#clip());
    const select = h("select", { "aria-label": "Compare with", onchange: () => this.store.set({ other: others.find(({ id }) => id === select.value) ?? null }) },
      h("option", { value: "" }, "compare with …"), others.map(({ id, name }) => h("option", { value: id }, name)));
    fill(this.place, others.length ? select : "");
    this.store.set({ other: null });
  }

  async #show() {
    const { other, map, layer, heading, stat } = this.store.values;
    this.#tiles?.remove();
    this.#tiles = null;
    for (const part of [this.range, this.line, ...this.names]) part.remove();
    if (!other) return;
    this.stage.append(this.line, ...this.names, this.range);
    const has = other.layers.some(({ name }) => name === layer);
    if (has) {
      const turned = other.headings > 1 ? heading : "mean";
      if (Math.abs(other.spacing - map.spacing) < HAIR && areBeside(other, map, HAIR)) {
        this.#tiles = servedTiles(this.source, other, layer, this.floor.top, turned, stat);
        this.#tiles.options.pane = "other";
      } else {
        this.#tiles = placedTiles(this.source, other, layer, turned, stat, "other");
      }
      this.#tiles.addTo(this.floor.leaflet);
    }
    fill(this.names[0], `${map.name}: ${map.scanner}`);
    fill(this.names[1], `${other.name}: ${other.scanner}${has ? "" : ", without this layer"}`);
    this.#clip();
    const [mine, theirs] = has ? await Promise.all([map, other].map(({ id }) => this.source.layer(id, layer))) : [];
    if (has && other === this.store.get("other") && layer === this.store.get("layer") && mine.max !== theirs.max) {
      this.names[1].append(`, colours up to ${Number(theirs.max.toPrecision(3))}${theirs.units === "m" ? " m" : ""}`);
    }
  }

  get #at() {
    return (this.stage.clientWidth * this.range.value) / STEPS;
  }

  #isRight(x, y) {
    return Boolean(this.#tiles) && this.floor.leaflet.latLngToContainerPoint([y, x]).x > this.#at;
  }

  #clip() {
    const { leaflet } = this.floor;
    if (!leaflet || !this.store.get("other")) return;
    const { x, y } = leaflet.getSize();
    const [from, to] = [[this.#at, 0], [x, y]].map((corner) => leaflet.containerPointToLayerPoint(corner));
    leaflet.getPane("other").style.clip = `rect(${from.y}px, ${to.x}px, ${to.y}px, ${from.x}px)`;
    this.line.style.setProperty("left", `${this.#at}px`);
  }
}
