// An obstacle by its numbers: what the pointer draws, for the keyboard.

import { fill, h } from "./dom.js";
import { ends, extent, KINDS, make, middle, moved } from "./obstacles.js";

const CHOICES = [["wall", "Wall", true], ["panel", "Panel", true], ["post", "Post", false], ["reflector", "Reflecting strip", true], ["reflector", "Reflecting post", false]];

export class EditForm {
  constructor(element, store, obstacles) {
    Object.assign(this, { store, obstacles });
    const field = (label, unit, value, least) => {
      const input = h("input", { type: "number", step: "any", name: label.toLowerCase(), value, min: least });
      return { input, line: h("label", {}, h("span", {}, label, h("i", {}, ` ${unit}`)), input) };
    };
    this.fields = {
      x: field("x", "m", null, null), y: field("y", "m", null, null), length: field("Length", "m", "2", 0.01), angle: field("Angle", "°", "0", null),
      thickness: field("Thickness", "m", null, 0), radius: field("Radius", "m", null, 0.005),
      bottom: field("Bottom", "m above the floor", "0", 0), top: field("Top", "m, empty: ceiling", null, 0),
    };
    this.kind = h("select", { "aria-label": "Kind of obstacle", onchange: () => this.#sizes() }, CHOICES.map(([, title], i) => h("option", { value: i }, title)));
    this.button = h("button", { type: "submit" });
    this.form = h("form", { onsubmit: (event) => {
      event.preventDefault();
      this.#done();
    } }, this.kind, h("div", { class: "grid" }, Object.values(this.fields).map(({ line }) => line)), this.button);
    fill(element, h("legend", {}, "By numbers"), h("p", { class: "soft" }, "x and y are the middle; the angle is counter-clockwise from x."), this.form);
    this.#sizes();
    store.watch(["picked", "obstacles"], () => this.#show());
    store.watch(["map"], () => this.#ask(this.#choice[2]));
  }

  get #choice() {
    return CHOICES[Number(this.kind.value)];
  }

  /** The sizes of a new one of the kind that is chosen. */
  #sizes() {
    const [kind, , straight] = this.#choice;
    this.#ask(straight);
    this.fields.thickness.input.value = KINDS[kind].thickness ?? 0;
    this.fields.radius.input.value = KINDS[kind].radius ?? 0.1;
  }

  /** Ask for what a kind has. */
  #ask(straight) {
    const inSpace = Boolean(this.store.get("map")?.in_space);
    for (const [name, { line, input }] of Object.entries(this.fields)) {
      const high = name === "bottom" || name === "top";
      const asked = high ? inSpace : ["x", "y"].includes(name) || straight === (name !== "radius");
      line.hidden = !asked;
      input.required = asked && !high;
      input.disabled = !asked;
    }
  }

  /** The numbers of the obstacle that is picked. */
  #show() {
    const { obstacles, picked } = this.store.values;
    const one = obstacles[picked ?? -1];
    this.button.textContent = one ? `Change obstacle ${picked + 1}` : "Add";
    if (!one) return;
    const straight = one.points.length > 1;
    this.kind.value = String(CHOICES.findIndex(([kind, , line]) => kind === one.kind && line === straight));
    this.#ask(straight);
    const [x, y] = middle(one);
    const { length, angle } = extent(one);
    const along = straight ? { length, angle: (angle * 180) / Math.PI } : {};
    const values = { x, y, ...along, thickness: one.thickness, radius: one.radius };
    for (const [name, value] of Object.entries(values)) this.fields[name].input.value = Number(value.toFixed(3));
    this.fields.bottom.input.value = one.bottom ?? 0;
    this.fields.top.input.value = one.top ?? "";
    // One with more corners can be moved alone.
    for (const name of ["length", "angle"]) this.fields[name].input.disabled ||= one.points.length > 2;
  }

  #done() {
    const { obstacles, picked } = this.store.values;
    const [kind, , straight] = this.#choice;
    const value = Object.fromEntries(Object.entries(this.fields).map(([name, { input }]) => [name, Number(input.value)]));
    const at = [value.x, value.y];
    const old = obstacles[picked ?? -1];
    const [x, y] = old ? middle(old) : at;
    const shape = old?.points.length > 2
      ? { ...moved(old, at[0] - x, at[1] - y), thickness: value.thickness }
      : straight ? { ...make(kind, ends(at, value.length, (value.angle * Math.PI) / 180)), thickness: value.thickness }
      : { ...make(kind, [at]), radius: value.radius };
    const { top, bottom } = this.fields;
    const high = top.input.disabled ? {} : { bottom: value.bottom, top: top.input.value === "" ? null : value.top };
    const one = { ...shape, ...high };
    if (old) this.obstacles.change(picked, one);
    else this.obstacles.add(one);
  }
}
