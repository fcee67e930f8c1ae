// What the parts of the page share: one object, and an event for each change of it.

/**
 * Values by name. `set` tells listeners of the names whose values changed.
 * map, layer, heading ("mean", "worst" or radians), theta, probe ({x, y}), pinned, place,
 * start, goal ([x, y]), weight, routes, overlays, tab.
 */
export class Store {
  #listeners = [];

  constructor(values) {
    this.values = { ...values };
  }

  get(name) {
    return this.values[name];
  }

  set(changes) {
    const changed = Object.keys(changes).filter((name) => !Object.is(this.values[name], changes[name]));
    if (!changed.length) return;
    Object.assign(this.values, changes);
    for (const [names, listener] of this.#listeners) {
      if (names.some((name) => changed.includes(name))) listener(this.values, changed);
    }
  }

  /** Call `listener` now, and whenever one of the names changes; returns what ends that. */
  watch(names, listener) {
    const entry = [names, listener];
    this.#listeners.push(entry);
    listener(this.values, names);
    return () => (this.#listeners = this.#listeners.filter((one) => one !== entry));
  }
}
