// Obstacles that are drawn into the building: what they are, as GeoJSON, and what can be undone.

import { axis, metres } from "./format.js";

/** Kinds by name; a reflector is round or straight. Sizes are those of a new one, metres. */
export const KINDS = {
  wall: { title: "Wall", straight: true, thickness: 0.1 },
  panel: { title: "Panel", straight: true, thickness: 0 },
  post: { title: "Post", round: true, radius: 0.15 },
  reflector: { title: "Reflector", straight: true, round: true, thickness: 0, radius: 0.1 },
};

/** A new obstacle of a kind: a straight one through points [x, y], a round one at a single one. */
export function make(kind, points) {
  const { thickness = 0, radius = 0 } = KINDS[kind];
  return { kind, points, ...(points.length > 1 ? { thickness, radius: 0 } : { thickness: 0, radius }) };
}

/** Moved by so many metres. */
export const moved = (one, dx, dy) => ({ ...one, points: one.points.map(([x, y]) => [x + dx, y + dy]) });

/** The middle of its bounds, [x, y]. */
export function middle({ points }) {
  return [0, 1].map((axis) => {
    const values = points.map((point) => point[axis]);
    return (Math.min(...values) + Math.max(...values)) / 2;
  });
}

/** Length in metres and angle in radians of a straight one, from its first corner to its last. */
export function extent({ points }) {
  const [[ax, ay], [bx, by]] = [points[0], points.at(-1)];
  return { length: Math.hypot(bx - ax, by - ay), angle: Math.atan2(by - ay, bx - ax) };
}

/** Both ends of a straight one of a length and an angle around a middle. */
export function ends([x, y], length, angle) {
  const [dx, dy] = [0.5 * length * Math.cos(angle), 0.5 * length * Math.sin(angle)];
  return [[x - dx, y - dy], [x + dx, y + dy]];
}

/** Outlines to draw, as rings of [x, y]; none of a line without thickness. */
export function rings({ points, radius, thickness }) {
  if (points.length === 1) {
    const [[x, y]] = points;
    return [Array.from({ length: 16 }, (_, i) => [x + radius * Math.cos((i * Math.PI) / 8), y + radius * Math.sin((i * Math.PI) / 8)])];
  }
  if (!thickness) return [];
  return points.slice(1).map(([bx, by], i) => {
    const [ax, ay] = points[i];
    const length = Math.hypot(bx - ax, by - ay) || 1;
    const [nx, ny] = [(-0.5 * thickness * (by - ay)) / length, (0.5 * thickness * (bx - ax)) / length];
    return [[ax + nx, ay + ny], [bx + nx, by + ny], [bx - nx, by - ny], [ax - nx, ay - ny]];
  });
}

/** What it is, in a line. */
export function text(one) {
  const { title } = KINDS[one.kind];
  const [x, y] = middle(one);
  const at = `at ${metres(x)}, ${metres(y)}${heights(one)}`;
  if (one.points.length === 1) return `${title}, radius ${metres(one.radius, 2)}, ${at}`;
  const { length, angle } = extent(one);
  return `${title}, ${metres(length)} at ${axis(angle)}, ${at}`;
}

/** Heights above the floor, of one that has any. */
function heights({ bottom = 0, top = null }) {
  if (top === null) return bottom ? `, from ${metres(bottom, 2)} up` : "";
  return `, ${metres(bottom, 2)} to ${metres(top, 2)} above the floor`;
}

const rounded = (value) => Math.round(value * 1e4) / 1e4;

/** A FeatureCollection, as the service and `ambinav design place` take it. */
export function collectionOf(obstacles) {
  const feature = ({ kind, points, radius, thickness, bottom = 0, top = null }) => {
    const corners = points.map((point) => point.map(rounded));
    const high = bottom || top !== null ? { bottom, top } : {};
    return points.length === 1
      ? { type: "Feature", properties: { kind, radius: rounded(radius), ...high }, geometry: { type: "Point", coordinates: corners[0] } }
      : { type: "Feature", properties: { kind, thickness: rounded(thickness), ...high }, geometry: { type: "LineString", coordinates: corners } };
  };
  return { type: "FeatureCollection", features: obstacles.map(feature) };
}

/** Obstacles of a FeatureCollection; an error says in a sentence what is wrong with it. */
export function obstaclesOf(document) {
  if (!Array.isArray(document?.features)) throw new Error("The file is not a FeatureCollection of obstacles.");
  return document.features.map(({ properties, geometry } = {}, i) => {
    const kind = properties?.kind;
    const points = geometry?.type === "Point" ? [geometry.coordinates] : geometry?.coordinates;
    const isPoint = (point) => Array.isArray(point) && point.length > 1 && point.slice(0, 2).every(Number.isFinite);
    if (!KINDS[kind] || !Array.isArray(points) || !points.every(isPoint)) throw new Error(`Obstacle ${i + 1} of the file is none.`);
    const known = { ...make(kind, points.map(([x, y]) => [x, y])), bottom: properties.bottom ?? 0, top: properties.top ?? null };
    return points.length > 1 ? { ...known, thickness: properties.thickness ?? 0 } : { ...known, radius: properties.radius ?? known.radius };
  });
}

/** The list in the store, under `obstacles`, and `picked` of it; every change can be undone and redone. */
export class Obstacles {
  /** Lists before each change, with the name of the change; and after each change that was undone. */
  #past = [];
  #future = [];

  constructor(store) {
    this.store = store;
  }

  get list() {
    return this.store.get("obstacles");
  }

  get canUndo() {
    return this.#past.length > 0;
  }

  get canRedo() {
    return this.#future.length > 0;
  }

  /** Names of the changes that can be undone, the last first. */
  get steps() {
    return this.#past.map(({ name }) => name).reverse();
  }

  /** Forget all: another map was opened. */
  clear() {
    this.#past = [];
    this.#future = [];
    this.store.set({ obstacles: [], picked: null, tool: "move", dragging: false });
  }

  add(one) {
    this.#set([...this.list, one], this.list.length, `Add ${one.kind} ${this.list.length + 1}`);
  }

  change(i, one) {
    this.#set(this.list.map((old, k) => (k === i ? one : old)), i, `Change ${one.kind} ${i + 1}`);
  }

  remove(i) {
    this.#set(this.list.filter((_, k) => k !== i), null, `Delete ${this.list[i].kind} ${i + 1}`);
  }

  replace(list, name = list.length ? "Open obstacles" : "Reset") {
    this.#set(list, null, name);
  }

  /** Undo so many changes. */
  undo(count = 1) {
    for (let k = 0; k < count; k += 1) this.#move(this.#past, this.#future);
  }

  redo() {
    this.#move(this.#future, this.#past);
  }

  #move(from, to) {
    if (this.store.get("dragging")) return;
    const step = from.pop();
    if (!step) return;
    to.push({ list: this.list, name: step.name });
    this.store.set({ obstacles: step.list, picked: null });
  }

  /** Begin a drag: `drag` then changes the list, and the whole drag is one thing to undo. */
  hold(i) {
    this.#keep(`Move ${this.list[i].kind} ${i + 1}`);
    this.store.set({ picked: i, dragging: true });
  }

  drag(i, one) {
    this.store.set({ obstacles: this.list.map((old, k) => (k === i ? one : old)) });
  }

  drop(i, one) {
    this.store.set({ dragging: false, obstacles: this.list.map((old, k) => (k === i ? one : old)) });
  }

  #set(obstacles, picked, name) {
    this.#keep(name);
    this.store.set({ obstacles, picked });
  }

  #keep(name) {
    this.#past.push({ list: this.list, name });
    this.#future = [];
  }
}
