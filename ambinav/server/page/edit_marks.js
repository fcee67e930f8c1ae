// Obstacles on the floor: drawn with the pointer, dragged as a whole or by their ends.
/* global L */

import { eachFrame } from "./dom.js";
import { badge } from "./overlays.js";
import { KINDS, make, middle, moved, rings, text } from "./obstacles.js";

/** Pixels from which a press is a line and not a click. */
const LINE = 8;
/** Pixels from which a press on an obstacle moves it. */
const NUDGE = 3;
const turned = (points) => points.map(([x, y]) => [y, x]);

export class EditMarks {
  #shapes = null;
  #handles = null;
  #draft = null;
  #pressed = null;
  #grabbed = null;
  #swallow = false;

  constructor(floor, store, obstacles, say) {
    Object.assign(this, { floor, store, obstacles, say });
    const { element } = floor;
    element.addEventListener("pointerdown", (event) => this.#press(event));
    element.addEventListener("pointermove", eachFrame((event) => this.#pull(event)));
    element.addEventListener("pointerup", (event) => this.#release(event));
    element.addEventListener("pointercancel", () => this.#end());
    // A click that ends a drag is none on the floor.
    element.addEventListener("click", (event) => {
      if (this.#swallow) event.stopImmediatePropagation();
      this.#swallow = false;
    }, true);
    store.watch(["obstacles", "picked"], () => this.#draw());
    store.watch(["tool", "tab"], () => this.#arm());
    store.watch(["tab", "dragging"], () => this.#hold());
  }

  /** A map was opened. */
  opened() {
    this.#shapes = this.#handles = this.#draft = this.#pressed = null;
    const { leaflet } = this.floor;
    leaflet.createPane("drawn").style.zIndex = 430;
    this.renderer = L.svg({ pane: "drawn", padding: 0.5 });
    this.#arm();
    this.#draw();
  }

  /** The tool that draws, or null. */
  get #tool() {
    const { tool, tab } = this.store.values;
    return tab === "edit" && tool !== "move" ? tool : null;
  }

  #arm() {
    const { leaflet, element } = this.floor;
    if (!leaflet) return;
    leaflet.dragging[this.#tool ? "disable" : "enable"]();
    leaflet.doubleClickZoom[this.#tool ? "disable" : "enable"]();
    element.classList.toggle("drawing", Boolean(this.#tool));
    element.classList.toggle("moving", this.store.get("tab") === "edit" && !this.#tool);
    if (this.#tool) this.store.set({ probe: null, pinned: false });
    this.#end();
  }

  #at(event) {
    const { lat, lng } = this.floor.leaflet.mouseEventToLatLng(event);
    return [lng, lat];
  }

  #press(event) {
    if (!this.#tool || event.button || event.target.closest(".leaflet-control, .obstacle, .corner")) return;
    if (this.#pressed) return this.#end(); // a second finger zooms
    this.#pressed = { id: event.pointerId, at: this.#at(event), x: event.clientX, y: event.clientY };
    this.floor.element.setPointerCapture(event.pointerId);
  }

  /** Begin to drag an obstacle by its shape. */
  #grab(i, event) {
    if (this.#tool || this.store.get("tab") !== "edit" || event.button) return;
    this.floor.leaflet.dragging.disable();
    this.#grabbed = { id: event.pointerId, i, at: this.#at(event), x: event.clientX, y: event.clientY, one: this.obstacles.list[i], isMoving: false };
    this.floor.element.setPointerCapture(event.pointerId);
  }

  /** The obstacle that is dragged, where the pointer has it. */
  #carried(event) {
    const { one, at } = this.#grabbed;
    const [x, y] = this.#at(event);
    return moved(one, x - at[0], y - at[1]);
  }

  #drawn(event) {
    const { at, x, y } = this.#pressed;
    const kind = this.#tool;
    const { round, straight } = KINDS[kind];
    const far = Math.hypot(event.clientX - x, event.clientY - y) >= LINE;
    if (straight && far) return make(kind, [at, this.#at(event)]);
    return round ? make(kind, [straight ? at : this.#at(event)]) : null;
  }

  #pull(event) {
    if (this.#grabbed?.id === event.pointerId) {
      const { i, x, y, isMoving } = this.#grabbed;
      if (!isMoving && Math.hypot(event.clientX - x, event.clientY - y) < NUDGE) return;
      if (!isMoving) this.obstacles.hold(i);
      this.#grabbed.isMoving = true;
      this.obstacles.drag(i, this.#carried(event));
    }
    if (this.#pressed?.id !== event.pointerId) return;
    this.#draft?.remove();
    const one = this.#drawn(event);
    this.#draft = one && L.layerGroup(this.#layers(one, "draft")).addTo(this.floor.leaflet);
  }

  #release(event) {
    if (this.#grabbed?.id === event.pointerId) {
      const { i, isMoving } = this.#grabbed;
      if (isMoving) this.obstacles.drop(i, this.#carried(event));
      else this.store.set({ picked: i });
      this.#swallow = true;
      setTimeout(() => (this.#swallow = false), 50);
      this.#grabbed = null;
      this.#arm();
    }
    if (this.#pressed?.id !== event.pointerId) return;
    const one = this.#drawn(event);
    const kind = this.#tool;
    this.#end();
    if (one) this.obstacles.add(one);
    else this.say(`Press, pull and let go to draw a ${kind}.`);
  }

  #end() {
    if (this.#grabbed?.isMoving) this.obstacles.drop(this.#grabbed.i, this.obstacles.list[this.#grabbed.i]);
    this.#grabbed = null;
    this.#draft?.remove();
    this.#draft = this.#pressed = null;
  }

  #layers(one, state) {
    const look = { renderer: this.renderer, pane: "drawn", interactive: false, smoothFactor: 0, className: `drawn ${one.kind} ${state}` };
    const line = one.points.length > 1 ? [[{ ...look, className: "drawn casing" }, 7], [look, 4]].map(([each, weight]) => L.polyline(turned(one.points), { ...each, weight })) : [];
    return [...line, ...rings(one).map((ring) => L.polygon(turned(ring), { ...look, weight: 2, fillOpacity: 1 }))];
  }

  #draw() {
    const { leaflet } = this.floor;
    if (!leaflet || !this.renderer) return;
    this.#shapes?.remove();
    const { obstacles, picked, dragging } = this.store.values;
    const shapes = obstacles.map((one, i) => L.featureGroup(this.#layers(one, i === picked ? "picked" : "")));
    this.#shapes = L.layerGroup(shapes).addTo(leaflet);
    shapes.forEach((shape, i) => shape.eachLayer((layer) => layer.getElement()?.addEventListener("pointerdown", (event) => this.#grab(i, event))));
    if (!dragging) this.#hold();
  }

  /** Handles; those of a drag stay while it lasts, or it would end. */
  #hold() {
    const { leaflet } = this.floor;
    const { obstacles, picked, dragging, tab } = this.store.values;
    this.floor.element.classList.toggle("holding", Boolean(dragging));
    if (!leaflet || dragging) return;
    this.#handles?.remove();
    const marks = tab === "edit" ? obstacles.flatMap((one, i) => [this.#whole(one, i), ...(i === picked ? this.#ends(one, i) : [])]) : [];
    this.#handles = L.layerGroup(marks).addTo(leaflet);
  }

  /** Moves all of an obstacle; it stands beside it, so that it can be seen. */
  #whole(one, i) {
    const icon = badge(String(i + 1), `obstacle${i === this.store.get("picked") ? " chosen" : ""}`);
    Object.assign(icon.options, { iconSize: [24, 24], iconAnchor: [-5, 29] });
    const [x, y] = middle(one);
    const mark = L.marker([y, x], { icon, draggable: true, autoPan: true, zIndexOffset: 4000 + i, title: `Obstacle ${i + 1}: ${text(one)}; drag to move it` });
    mark.on("click", () => this.store.set({ picked: i }));
    return this.#dragged(mark, i, ({ lat, lng }) => moved(one, lng - x, lat - y));
  }

  #ends(one, i) {
    if (one.points.length === 1) return [];
    return one.points.map(([x, y], k) => {
      const icon = L.divIcon({ className: "corner", html: "<span></span>", iconSize: [24, 24], iconAnchor: [12, 12] });
      const mark = L.marker([y, x], { icon, draggable: true, autoPan: true, zIndexOffset: 5000, title: `Corner ${k + 1} of obstacle ${i + 1}; drag to move it` });
      return this.#dragged(mark, i, ({ lat, lng }) => ({ ...one, points: one.points.map((old, other) => (other === k ? [lng, lat] : old)) }));
    });
  }

  #dragged(mark, i, change) {
    const follow = eachFrame(() => this.store.get("dragging") && this.obstacles.drag(i, change(mark.getLatLng())));
    mark.on("dragstart", () => this.obstacles.hold(i));
    mark.on("drag", follow);
    mark.on("dragend", () => this.obstacles.drop(i, change(mark.getLatLng())));
    return mark;
  }
}
