// The address of the page says what it shows, so that it can be kept and sent to others.

import { settled } from "./dom.js";

const QUIET = 300;

/** What the address asks for: a map, a layer, a heading, and the middle and zoom of the view. */
export function readView() {
  const query = new URLSearchParams(location.search);
  const at = (query.get("at") ?? "").split(",").map(Number);
  return {
    map: query.get("map"), layer: query.get("layer"), heading: query.get("heading"),
    at: at.length === 3 && at.every(Number.isFinite) ? at : null,
  };
}

/** Show that of the open map. */
export function showView({ layer, heading, at }, floor, store) {
  if (store.get("map").layers.some(({ name }) => name === layer)) store.set({ layer });
  if (heading === "worst" || heading === "mean") store.set({ heading });
  else if (heading !== null && Number.isFinite(Number(heading))) store.set({ heading: Number(heading), theta: Number(heading) });
  if (at) floor.show(...at);
}

/** Keep the address up to date; the middle is part of it once somebody has moved the map. */
export function followView(floor, store) {
  const write = settled(() => {
    const { map, layer, heading, session } = store.values;
    const query = new URLSearchParams({ map: map.id });
    if (layer !== "zone") query.set("layer", layer);
    if (heading !== "mean") query.set("heading", heading);
    if (floor.flown) query.set("at", [floor.centre.x.toFixed(2), floor.centre.y.toFixed(2), floor.leaflet.getZoom()].join(","));
    if (session) query.set("session", session);
    history.replaceState(null, "", `?${query}${location.hash}`);
  }, QUIET);
  let leave = () => {};
  store.watch(["map"], () => {
    const { leaflet } = floor;
    leave();
    leaflet.on("moveend", write);
    leave = () => leaflet.off("moveend", write);
  });
  store.watch(["map", "layer", "heading", "session"], write);
}
