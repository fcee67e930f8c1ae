// Routes on the floor, and the marks of start and goal that can be dragged.
/* global L */

import { lossLines, nearestPlace, tipText } from "./forecast.js";
import { badge } from "./overlays.js";
import style from "./style.js";

/** Style of a route: `kind` of the table of colours, and how many of the kind came before. */
export function routeStyle(kind, before) {
  const styles = style.routes[kind] ?? style.routes.ambiguity;
  return styles[before % styles.length];
}

/** Pixels across which the pointer meets a route. */
const REACH = 14;
/** Pixels that a tooltip needs on either side, and on the right of a wide map, where the readout is. */
const [ROOM, READOUT] = [90, 360];

/** Beads on the stretches that lose robots; their shape says it to those who see no red. */
function lossMarks(lines, strong, options) {
  const points = lines.map((line) => line.map(([x, y]) => [y, x]));
  const weight = strong ? 8 : 6.5;
  const bead = { ...options, dashArray: `0 ${2.2 * weight}`, lineCap: "round" };
  return [
    L.polyline(points, { ...bead, color: "#fff", weight: weight + 4 }),
    L.polyline(points, { ...bead, color: style.lost, weight }),
  ];
}

export class RouteLines {
  #group = null;
  #ends = {};
  #tip = L.tooltip({ className: "route-tip", opacity: 1 });

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
    if (!shown.length) this.#tip.remove();
    shown.sort((a, b) => (a.key === chosen) - (b.key === chosen)); // the chosen one lies above the others
    const lines = shown.flatMap((one) => {
      const points = one.route.map(([x, y]) => [y, x]);
      const strong = chosen === one.key;
      const width = strong ? 5 : 3.5;
      const { colour, casing, dashes } = one.style;
      const dashArray = dashes.length ? dashes.map((part) => part * width).join(" ") : null;
      const still = { interactive: false };
      return [
        L.polyline(points, { ...still, color: casing, weight: width + 2.6, opacity: 0.9 }),
        L.polyline(points, { ...still, color: colour, weight: width, dashArray, lineCap: dashArray ? "butt" : "round" }),
        ...(one.forecast ? lossMarks(lossLines(one.forecast), strong, still) : []),
        this.#reach(one, points),
      ];
    });
    this.#group = L.layerGroup(lines).addTo(leaflet);
  }

  /** What the pointer meets of a route: a click chooses it, and a tooltip shows its forecast there. */
  #reach(one, points) {
    const showTip = ({ latlng: { lat, lng } }) => {
      const place = nearestPlace(one.forecast, lng, lat);
      this.#tip.options.direction = this.#side([place.y_m, place.x_m]);
      this.#tip.setContent(tipText(one, place)).setLatLng([place.y_m, place.x_m]).addTo(this.floor.leaflet);
    };
    const line = L.polyline(points, { weight: REACH, opacity: 0 }).on("click", (event) => {
      L.DomEvent.stopPropagation(event);
      this.store.set({ chosen: one.key });
    });
    if (!one.forecast) return line;
    const touch = matchMedia("(hover: none)").matches; // the next tap closes the tooltip there
    return line.on("mouseover mousemove click", showTip).on("mouseout", () => touch || this.#tip.remove());
  }

  /** The side of a place on which a tooltip hides neither the route nor itself. */
  #side(at) {
    const { x: width, y: height } = this.floor.leaflet.getSize();
    const { x, y } = this.floor.leaflet.latLngToContainerPoint(at);
    if (x < ROOM) return "right";
    if (x > width - (width < 600 ? ROOM : READOUT)) return "left";
    return y < height / 2 ? "bottom" : "top";
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
