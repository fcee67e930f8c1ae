// The map of the floor: Leaflet, the layer that is shown, walls, scale bar.
/* global L */

import { h, svg } from "./dom.js";
import style from "./style.js";
import { frameOf, levelsFor, rasterTiles, servedTiles } from "./tiles.js";
import { shadesOf } from "./theme.js";

const MARGIN = 20;
/** Milliseconds for which the rest of the page waits for the first picture. */
const PATIENCE = 3000;

export class FloorMap {
  #floors = [];
  #walls = null;
  #lines = null;
  #asked = 0;
  #watcher = null;

  /** `progress` is called with how many tiles of a floor are there, and how many it has. */
  constructor(element, source, store, progress = () => {}) {
    Object.assign(this, { element, source, store, progress });
  }

  /** Show a map of the source; what an earlier one showed is gone. */
  async open(map) {
    this.leaflet?.remove();
    this.#floors = [];
    this.#walls = null;
    this.map = map;
    this.shown = map.id;
    this.top = map.max_zoom ?? levelsFor(map.shape) - 1;
    const [x0, y0, x1, y1] = map.bounds;
    this.bounds = L.latLngBounds([y0, x0], [y1, x1]);
    this.leaflet = L.map(this.element, {
      crs: frameOf(map, this.top),
      attributionControl: false,
      zoomControl: false,
      zoomSnap: 0.25,
      zoomDelta: 1,
      wheelPxPerZoomLevel: 90,
      maxZoom: this.top + 6,
      minZoom: -3,
      maxBounds: this.bounds.pad(2),
      preferCanvas: true,
    });
    const zoom = L.control.zoom({ position: "topleft", zoomInTitle: "Zoom in", zoomOutTitle: "Zoom out" }).addTo(this.leaflet);
    zoom.getContainer().append(this.#whole());
    L.control.scale({ position: "bottomright", imperial: false, maxWidth: this.element.clientWidth < 600 ? 80 : 120 }).addTo(this.leaflet);
    // They lie above the routes, which the pointer meets through them.
    Object.assign(this.leaflet.createPane("strokes").style, { zIndex: 420, pointerEvents: "none" });
    Object.assign(this.leaflet.createPane("walls").style, { zIndex: 410, pointerEvents: "none" });
    this.fit();
    this.#keepFitting();
    // The first picture goes before all else that is asked for.
    await Promise.race([this.#showFloor(), new Promise((resolve) => setTimeout(resolve, PATIENCE))]);
    this.#showWalls();
  }

  /** Show another version of the map that is open: an edited one, or the original again. */
  async swap(id) {
    this.shown = id;
    await Promise.race([this.#showFloor(), new Promise((resolve) => setTimeout(resolve, PATIENCE))]);
  }

  /** The whole floor in view. */
  fit() {
    const narrow = this.element.clientWidth < 600;
    // Room for the readout above and the legend below.
    this.leaflet.fitBounds(this.bounds, {
      paddingTopLeft: [MARGIN, narrow ? 3 * MARGIN : MARGIN],
      paddingBottomRight: [MARGIN, narrow ? 4 * MARGIN : 2.5 * MARGIN],
      animate: false,
    });
  }

  /** A button that shows the whole floor, in the manner of Leaflet's own. */
  #whole() {
    const show = (event) => {
      event.preventDefault();
      event.stopPropagation();
      this.fit();
    };
    const frame = svg("path", { d: "M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5" });
    return h("a", { href: "#", role: "button", class: "whole", title: "Show the whole floor", "aria-label": "Show the whole floor", onclick: show, ondblclick: (event) => event.stopPropagation() },
      svg("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, frame));
  }

  /** Until somebody moves the map, it fits its element whatever size that gets. */
  #keepFitting() {
    const { leaflet } = this;
    this.flown = false;
    const touched = () => (this.flown = true);
    for (const kind of ["pointerdown", "wheel", "keydown"]) this.element.addEventListener(kind, touched, { once: true, passive: true });
    this.#watcher?.disconnect();
    this.#watcher = new ResizeObserver(() => {
      leaflet.invalidateSize({ animate: false });
      if (!this.flown) this.fit();
    });
    this.#watcher.observe(this.element);
  }

  /** Fly to a place; so many metres around it are in view. */
  flyTo(x, y, around = 8) {
    this.flown = true;
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const box = L.latLngBounds([y - around, x - around], [y + around, x + around]);
    const zoom = Math.min(this.leaflet.getBoundsZoom(box), this.top + 3);
    // On a narrow map the readout covers the upper part.
    const lower = this.element.clientWidth < 600 ? 50 : 0;
    const centre = this.leaflet.unproject(this.leaflet.project([y, x], zoom).subtract([0, lower]), zoom);
    this.leaflet[still ? "setView" : "flyTo"](centre, zoom, { duration: 0.8 });
  }

  /** Show a place in the middle at a zoom. */
  show(x, y, zoom) {
    this.flown = true;
    this.leaflet.setView([y, x], zoom, { animate: false });
  }

  /** Id of the map that is shown at a point; `comparison.js` puts another one beside it. */
  idAt() {
    return this.shown;
  }

  /** Metres of the map frame in the middle of the view. */
  get centre() {
    const { lat, lng } = this.leaflet.getCenter();
    return { x: lng, y: lat };
  }

  /** Bounds of the view in metres: [x0, y0, x1, y1]. */
  get view() {
    const box = this.leaflet.getBounds();
    return [box.getWest(), box.getSouth(), box.getEast(), box.getNorth()];
  }

  /** Follow the store: layer, heading, colours, walls. */
  follow() {
    this.store.watch(["layer", "heading", "stat", "theme"], () => this.map && this.#showFloor());
    this.store.watch(["overlays", "theme"], () => this.map && this.#showWalls());
  }

  async #showFloor() {
    const asked = ++this.#asked;
    const { layer, heading } = this.store.values;
    const version = this.shown;
    const fresh = await this.#tiles(layer, heading);
    if (asked !== this.#asked) return;
    const floors = this.#floors;
    let [done, all] = [0, 0];
    fresh.on("tileloadstart", () => (all += 1));
    fresh.on("tileload tileerror", () => this.progress(++done, all));
    floors.push(fresh.addTo(this.leaflet));
    // The old ones stay until the new one is there, so that nothing flickers.
    fresh.once("load", () => {
      while (floors.includes(fresh) && floors[0] !== fresh) floors.shift().remove();
    });
    this.element.dataset.layer = layer;
    await new Promise((resolve) => fresh.once("load", resolve));
    Object.assign(this.element.dataset, { shown: layer, version });
  }

  async #tiles(layer, heading) {
    if (!this.source.raster) return servedTiles(this.source, { ...this.map, id: this.shown }, layer, this.top, heading, this.store.get("stat"));
    const raster = await this.source.raster(layer);
    return rasterTiles(raster.paint(shadesOf(this.element), layer === "zone"), this.map, this.top);
  }

  async #showWalls() {
    const id = this.map.id;
    if (this.#lines?.id !== id) {
      this.#lines = { id, found: await this.source.walls(id) };
      if (this.map.id !== id) return;
    }
    this.#walls?.remove();
    this.#walls = null;
    if (!this.store.get("overlays").walls) return;
    const { found } = this.#lines;
    if (found === null) {
      this.#walls = servedTiles(this.source, this.map, "walls", this.top, null, "worst");
    } else {
      // Custom properties are not resolved; the element's colour is the same one.
      const { color } = getComputedStyle(this.element);
      const turned = (lines) => lines.map((line) => line.map(([x, y]) => [y, x]));
      const shared = { pane: "walls", interactive: false, smoothFactor: 0.5 };
      this.#walls = L.layerGroup([
        L.polyline(turned(found.frontiers), { ...shared, color: style.frontier, weight: 1, dashArray: "4 3" }),
        L.polyline(turned(found.walls), { ...shared, color, weight: 1.4 }),
        L.polyline(turned(found.reflectors), { ...shared, color: style.wall, weight: 5 }),
        L.polyline(turned(found.reflectors), { ...shared, color: style.reflector, weight: 3 }),
      ]);
    }
    this.#walls.addTo(this.leaflet);
  }
}
