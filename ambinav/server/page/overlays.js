// What lies over the floor: weak direction, the expected scan, the probe, the worst places.
/* global L */

import { area, axis, number } from "./format.js";
import { settled } from "./dom.js";

const MOST_STROKES = 400;
/** Pixels of the view that a stroke has to itself, at least. */
const ROOM = 1000;
/** Of a view beside the map as little is left, metres, or less than nothing. */
const SLIVER = 0.05;
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Round label as an icon; its text is said to screen readers by the marker's title. */
export function badge(text, kind) {
  return L.divIcon({ className: `badge ${kind}`, html: `<span>${text}</span>`, iconSize: [26, 26], iconAnchor: [13, 13] });
}

/** Strokes along which the robot can slide unseen. */
export class Strokes {
  #lines = null;
  #abort = null;

  constructor(floor, source, store) {
    Object.assign(this, { floor, source, store });
    store.watch(["overlays", "theme", "version"], () => this.draw());
  }

  /** A map was opened. */
  opened() {
    this.#lines = null;
    this.floor.leaflet.on("moveend", settled(() => this.draw(), 120));
    this.draw();
  }

  async draw() {
    if (!this.floor.leaflet) return;
    if (!this.store.get("overlays").direction) {
      this.#lines?.remove();
      this.#lines = null;
      return;
    }
    this.#abort?.abort();
    this.#abort = new AbortController();
    const { leaflet, map, view } = this.floor;
    const { x: width, y: height } = leaflet.getSize();
    const most = Math.max(Math.min(MOST_STROKES, Math.round((width * height) / ROOM)), 20);
    const box = clip(view, map.bounds);
    if (box[2] - box[0] < SLIVER || box[3] - box[1] < SLIVER) {
      this.#lines?.remove();
      return;
    }
    let glyphs;
    try {
      glyphs = await this.source.direction(this.floor.shown, box, most, this.#abort.signal);
    } catch (problem) {
      if (problem.name === "AbortError") return;
      throw problem;
    }
    if (leaflet !== this.floor.leaflet) return;
    const lines = glyphs.map(({ x, y, direction, length }) => {
      const [dx, dy] = [0.5 * length * Math.cos(direction), 0.5 * length * Math.sin(direction)];
      return [[y - dy, x - dx], [y + dy, x + dx]];
    });
    this.#lines?.remove();
    const shared = { pane: "strokes", interactive: false }; // the pane has one canvas, which stays
    this.#lines = L.layerGroup([
      L.polyline(lines, { ...shared, color: "#fff", weight: 3.6, opacity: 0.7 }),
      L.polyline(lines, { ...shared, color: colour("--wall"), weight: 1.8 }),
    ]).addTo(leaflet);
  }
}

function clip([x0, y0, x1, y1], [bx0, by0, bx1, by1]) {
  return [Math.max(x0, bx0), Math.max(y0, by0), Math.max(Math.min(x1, bx1), bx0), Math.max(Math.min(y1, by1), by0)];
}

/** Where values are read, and the scan that is expected there. */
export class Probe {
  #group = null;

  constructor(floor) {
    this.floor = floor;
  }

  clear() {
    this.#group?.remove();
    this.#group = null;
  }

  /** Draw a point and its scan, null where there is none. */
  draw({ x, y }, scan, pinned, theta) {
    this.clear();
    const parts = [];
    if (scan) {
      const ring = scan.x.map((sx, i) => [scan.y[i], sx]);
      const { hit, silent } = { hit: colour("--echo"), silent: colour("--silent") };
      parts.push(L.polygon(isRound(scan, x, y) ? ring : [[y, x], ...ring], { stroke: false, fillColor: hit, fillOpacity: 0.16, interactive: false }));
      const ends = (echoes) => ring.filter((_, i) => Boolean(scan.hit[i]) === echoes);
      const many = ring.length > 120;
      if (!many) {
        for (const [echoes, shade] of [[true, hit], [false, silent]]) {
          const beams = ends(echoes).map((end) => [[y, x], end]);
          parts.push(L.polyline(beams, { color: shade, weight: 1, opacity: 0.55, interactive: false }));
        }
      }
      for (const [echoes, shade] of [[true, hit], [false, silent]]) {
        const step = Math.max(1, Math.floor(ring.length / 360));
        for (const end of ends(echoes).filter((_, i) => i % step === 0)) {
          parts.push(L.circleMarker(end, { radius: 2, stroke: false, fillColor: shade, fillOpacity: 0.95, interactive: false }));
        }
      }
      if (theta !== null) {
        const far = 0.8;
        const tip = [y + far * Math.sin(theta), x + far * Math.cos(theta)];
        parts.push(L.polyline([[y, x], tip], { color: colour("--wall"), weight: 3, interactive: false }));
      }
    }
    parts.push(L.circleMarker([y, x], { radius: 6, color: "#fff", weight: 2, fillColor: colour("--wall"), fillOpacity: 1, interactive: false }));
    if (pinned) parts.push(L.circleMarker([y, x], { radius: 11, color: colour("--wall"), weight: 2, fill: false, interactive: false }));
    this.#group = L.layerGroup(parts).addTo(this.floor.leaflet);
  }
}

/** Whether a scan goes all around: its last beam is beside its first. */
function isRound({ x: ends, y: heights }, x, y) {
  const [first, last] = [0, ends.length - 1].map((i) => Math.atan2(heights[i] - y, ends[i] - x));
  return ends.length > 8 && Math.abs(Math.atan2(Math.sin(last - first), Math.cos(last - first))) < Math.PI / 12;
}

/** Numbered marks of the worst places. */
export class PlaceMarks {
  #group = null;

  constructor(floor, store) {
    Object.assign(this, { floor, store });
    this.places = [];
    store.watch(["overlays"], () => this.draw());
    store.watch(["place"], ({ place }) => this.#mark(place));
  }

  opened(places) {
    this.places = places;
    this.draw();
  }

  draw() {
    this.#group?.remove();
    this.#group = null;
    if (!this.floor.leaflet || !this.store.get("overlays").places) return;
    const marks = this.places.map((place, i) =>
      L.marker([place.y, place.x], {
        icon: badge(place.number ?? i + 1, "place"),
        title: `Place ${place.number ?? i + 1}: ${placeText(place)}`,
        alt: `Place ${place.number ?? i + 1}`,
        zIndexOffset: 1000 - i,
      }).on("click", () => this.store.set({ place: i })),
    );
    this.marks = marks;
    this.#group = L.layerGroup(marks).addTo(this.floor.leaflet);
    this.#mark(this.store.get("place"));
  }

  #mark(chosen) {
    this.marks?.forEach((mark, i) => mark.getElement()?.classList.toggle("chosen", i === chosen));
  }
}

/** A place in a line. */
export function placeText(place) {
  const parts = [place.zone, area(place.area_m2), `level ${number(place.level)}`];
  if (typeof place.weak_direction === "number") parts.push(`weak direction ${axis(place.weak_direction)}`);
  return parts.filter(Boolean).join(", ");
}
