// Routes on the floor, and the marks of start and goal that can be dragged.
/* global L */

import { badge } from "./overlays.js";
import style from "./style.js";

/** Style of a route: `kind` of the table of colours, and how many of the kind came before. */
export function routeStyle(kind, before) {
  const styles = style.routes[kind] ?? style.routes.ambiguity;
  return styles[before % styles.length];
}

export class RouteLines {
  #group = null;
  #ends = {};

  constructor(floor, store) {
    Object.assign(this, { floor, store });
    store.watch(["routes", "chosen", "trial"], () => this.draw());
    store.watch(["start", "goal"], () => this.#drawEnds());
  }

  opened() {
    this.#group = null;
    this.#ends = {};
    this.draw();
    this.#drawEnds();
  }

  draw() {
    this.#group?.remove();
    this.#group = null;
    const { leaflet } = this.floor;
    if (!leaflet) return;
    const { routes, chosen, trial } = this.store.values;
    const shown = [...(routes ?? []), ...(trial ? [trial] : [])].filter(({ hidden }) => !hidden);
    const lines = shown.flatMap((one) => {
      const points = one.route.map(([x, y]) => [y, x]);
      const strong = chosen === one.key;
      const width = strong ? 5 : 3.5;
      const { colour, casing, dashes } = one.style;
      const dashArray = dashes.length ? dashes.map((part) => part * width).join(" ") : null;
      return [
        L.polyline(points, { color: casing, weight: width + 2.6, opacity: 0.9, interactive: false }),
        L.polyline(points, { color: colour, weight: width, dashArray, lineCap: dashArray ? "butt" : "round" })
          .on("click", (event) => {
            L.DomEvent.stopPropagation(event);
            this.store.set({ chosen: one.key });
          }),
      ];
    });
    this.#group = L.layerGroup(lines).addTo(leaflet);
  }

  #drawEnds() {
    if (!this.floor.leaflet) return;
    for (const name of ["start", "goal"]) {
      const place = this.store.get(name);
      if (!place) {
        this.#ends[name]?.remove();
        delete this.#ends[name];
        continue;
      }
      const at = [place[1], place[0]];
      if (this.#ends[name]) this.#ends[name].setLatLng(at);
      else this.#ends[name] = this.#end(name, at);
    }
  }

  #end(name, at) {
    const mark = L.marker(at, {
      icon: badge(style.letters[name], name),
      draggable: Boolean(this.store.get("canPlan")),
      autoPan: true,
      title: `${name === "start" ? "Start" : "Goal"} of the route${this.store.get("canPlan") ? "; drag to move it" : ""}`,
      alt: name,
      zIndexOffset: 3000,
    });
    mark.on("dragend", () => {
      const { lat, lng } = mark.getLatLng();
      this.store.set({ [name]: [lng, lat] });
    });
    return mark.addTo(this.floor.leaflet);
  }
}
