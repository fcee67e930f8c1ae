// The map with its panels: on the page of the service, and at the head of a report.

import { aboutPanel } from "./about_panel.js";
import { fill, h } from "./dom.js";
import { FloorMap } from "./floor_map.js";
import { givenRoutes } from "./given_routes.js";
import { followFocus, followKeys } from "./keys.js";
import { layersPanel } from "./layers_panel.js";
import { followLegend } from "./legend.js";
import { PlaceMarks, Strokes } from "./overlays.js";
import { placesPanel } from "./places_panel.js";
import { Readout } from "./readout.js";
import { RouteLines } from "./route_lines.js";
import { RoutesPanel } from "./routes_panel.js";
import { Store } from "./store.js";
import { makeTabs } from "./tabs.js";
import { currentTheme } from "./theme.js";

/**
 * Build the explorer into `root`; returns its store, and `open(map)`. `editor` is the module of that
 * name where maps can be edited.
 */
export function makeExplorer(root, source, { tab = "layers", routes = [], editor = null } = {}) {
  const store = new Store({
    map: null, layer: "zone", heading: "mean", stat: "mean", theta: 0, probe: null, pinned: false, place: null, start: null, goal: null,
    weight: 5, routes: [], chosen: null, trial: null, canPlan: source.can.plan, tab, theme: currentTheme(),
    overlays: { walls: true, direction: true, scan: true, places: true }, other: null, version: null, ...editor?.EDIT_VALUES,
  });
  const parts = build(root, { places: !routes.length, routes: source.can.plan || routes.length > 0, edit: editor !== null });
  const floor = new FloorMap(parts.map, source, store, (done, all) => {
    parts.waiting.textContent = `Loading the floor: ${done} of ${all} tiles`;
  });
  const strokes = new Strokes(floor, source, store);
  const marks = new PlaceMarks(floor, store);
  const lines = new RouteLines(floor, store);
  const readout = new Readout(parts.readout, floor, source, store);
  let places = [];
  let opened = 0;
  let leavePlaces = () => {};
  const planner = source.can.plan ? new RoutesPanel(parts.panels.routes, floor, source, store) : null;
  layersPanel(parts.panels.layers, store, source.can);
  makeTabs(parts.tabs, parts.tabList, store);
  followLegend(parts.legend, source, store);
  followKeys(parts.map, floor, store, () => places);
  followFocus();
  floor.follow();
  const edits = editor?.makeEditor(parts.panels.edit, floor, source, store, show) ?? null;

  async function open(short) {
    const mine = ++opened;
    leavePlaces();
    places = [];
    parts.stage.setAttribute("aria-busy", "true");
    parts.waiting.textContent = "Opening the map …";
    store.set({ place: null, probe: null, pinned: false, heading: "mean", theta: 0 });
    if (!short.layers.some(({ name }) => name === store.get("layer"))) store.set({ layer: "zone" });
    await floor.open(short);
    if (mine !== opened) return; // another map was chosen meanwhile
    store.set({ map: short, version: short.id });
    readout.opened(short);
    strokes.opened();
    lines.opened();
    planner?.opened(short);
    edits?.opened(short);
    if (routes.length) store.set({ given: givenRoutes(parts.panels.routes, routes, floor, store) });
    clicks(floor, store, planner);
    fill(parts.panels.places, h("p", { class: "soft", role: "status" }, "Looking for the worst places …"));
    await describe(short.id);
    if (mine === opened) parts.stage.removeAttribute("aria-busy");
  }

  /** Zones, parameters and worst places of the version that is shown. */
  async function describe(id) {
    const { map } = floor;
    const [details, found] = await Promise.all([source.map(id), source.worst(id)]);
    if (map !== floor.map || id !== floor.shown) return;
    leavePlaces();
    store.set({ place: null });
    planner?.described(details);
    places = Array.isArray(found) ? found : found.places;
    marks.opened(places);
    leavePlaces = placesPanel(parts.panels.places, places, floor, store);
    aboutPanel(parts.panels.about, { ...map, ...details }, { ...source.can, edit: editor !== null });
  }

  /** Show a version of the open map; what takes longer follows when it is finished. */
  async function show(id, finished) {
    if (store.get("map") !== floor.map) return; // another map is being opened
    if (floor.shown !== id) {
      await floor.swap(id);
      store.set({ version: id });
    }
    if (!finished) return;
    planner?.changed();
    await describe(id);
  }
  return { store, floor, open };
}

/** A click sets start and goal while routes are planned; else it holds the point, or lets it go. */
function clicks(floor, store, planner) {
  floor.leaflet.on("click", ({ latlng }) => {
    if (store.get("tab") === "edit" && store.get("tool") !== "move") return; // it was drawn
    const at = { x: latlng.lng, y: latlng.lat };
    if (store.get("tab") === "routes" && planner?.take(at)) return;
    const touch = matchMedia("(hover: none)").matches;
    store.set(store.get("pinned") && !touch ? { pinned: false, probe: at } : { pinned: true, probe: at });
  });
}

function build(root, has) {
  const panel = () => h("section", { class: "tab" });
  const panels = { layers: panel(), places: panel(), routes: panel(), edit: panel(), about: panel() };
  const map = h("div", { class: "map", role: "region", "aria-label": "Floor map", tabindex: 0 });
  const readout = h("div", { class: "readout card", "aria-live": "polite" });
  const legend = h("div", { class: "legend card", role: "group", "aria-label": "Legend" });
  const cross = h("div", { class: "cross", "aria-hidden": "true" });
  const waiting = h("p", { class: "waiting card", role: "status" });
  const stage = h("div", { class: "stage", "aria-busy": "true" }, map, cross, legend, readout, waiting);
  const tabs = h("div", { class: "tabs", "aria-label": "Panels" });
  const tabList = [["layers", "Layers", panels.layers], has.places && ["places", "Places", panels.places], has.routes && ["routes", "Routes", panels.routes], has.edit && ["edit", "Edit", panels.edit], ["about", "About", panels.about]].filter(Boolean);
  fill(root, stage, h("div", { class: "panel" }, tabs, h("div", { class: "panels" }, tabList.map(([, , one]) => one))));
  root.classList.add("explorer");
  root.removeAttribute("aria-busy");
  return { map, stage, waiting, readout, legend, tabs, tabList, panels };
}
