// Keeps the map that is shown in step with the obstacles: one request at a time, the latest wins.

import { collectionOf } from "./obstacles.js";

/** While too many others wait, so often is asked again, after so many milliseconds. */
const TRIES = 10;
const PAUSE = 1500;

export class EditSync {
  #running = null;
  #waiting = false;
  #restoring = null;
  #shown = [];

  /** `show(id, finished)` shows a version of the map; `finished` is false while something is dragged. */
  constructor(source, store, show) {
    Object.assign(this, { source, store, show });
    const given = new URLSearchParams(location.search).get("session") ?? "";
    this.isNew = !/^[\w-]{1,64}$/.test(given);
    this.session = this.isNew ? `page-${Math.random().toString(36).slice(2)}` : given;
    source.restore = () => this.#restore();
    store.watch(["obstacles"], () => this.#follow());
    store.watch(["original"], () => this.map && store.get("edited") && this.#display());
  }

  /** A map was opened: nothing is drawn in it yet. */
  opened(map) {
    this.#running?.abort();
    this.map = map;
    this.#shown = [];
    this.warm = false;
    this.store.set({ session: this.isNew ? null : this.session, edited: null, original: false, trouble: null, working: false });
  }

  /** Features that the session of the page's address has in the map; none in a new session. */
  async kept() {
    const { map } = this;
    if (this.isNew) return [];
    try {
      const { current } = await this.source.session(map.id, this.session);
      return current === map.id ? [] : (await this.source.obstacles(current)).features;
    } catch (problem) {
      this.store.set({ trouble: problem.message });
      return [];
    }
  }

  /** Have the service make a process ready; what else goes wrong with it is said of the first edit. */
  async prepare() {
    const { map } = this;
    if (this.warm || !map) return;
    this.warm = true;
    try {
      await this.source.edit(map.id, collectionOf([]), {});
    } catch (problem) {
      if (problem.status === 422 && map === this.map) this.store.set({ trouble: problem.message });
    }
  }

  async #follow() {
    if (!this.map) return;
    if (this.#running) {
      this.#waiting = true;
      // While something is dragged each answer is shown; what is dropped takes the place of it.
      if (!this.store.get("dragging")) this.#running.abort();
      return;
    }
    this.#running = new AbortController();
    this.store.set({ working: true });
    let tries = TRIES;
    do {
      this.#waiting = false;
      const isBusy = await this.#ask();
      if (isBusy && --tries > 0) {
        this.#waiting = true;
        await new Promise((resolve) => setTimeout(resolve, PAUSE));
      }
    } while (this.#waiting);
    this.#running = null;
    this.store.set({ working: false });
  }

  /** Have the latest obstacles worked out and shown; whether the service has too much to do. */
  async #ask() {
    const { map, store } = this;
    const obstacles = store.get("obstacles");
    if (!obstacles.length && !store.get("edited")) return false; // the original is shown
    if (this.#running.signal.aborted) this.#running = new AbortController();
    try {
      const draft = Boolean(store.get("dragging"));
      const found = obstacles.length ? await this.source.edit(map.id, collectionOf(obstacles), { session: this.session, draft }, this.#running.signal) : null;
      if (map !== this.map) return false;
      if (!draft) store.set({ session: this.session });
      this.#shown = obstacles;
      store.set({ edited: found, trouble: null, ...(found ? {} : { original: false }) });
      await this.#display();
    } catch (problem) {
      if (map === this.map && problem.name !== "AbortError" && problem.status !== 409) store.set({ trouble: problem.message });
      return problem.status === 503;
    }
    return false;
  }

  #display() {
    const { edited, original, dragging } = this.store.values;
    return this.show(edited && !original ? edited.id : this.map.id, !dragging);
  }

  /** Bring back the map that is shown, which the service has forgotten; whether that was possible. */
  #restore() {
    this.#restoring ??= this.source.edit(this.map.id, collectionOf(this.#shown), {})
      .then(() => true, () => false)
      .finally(() => (this.#restoring = null));
    return this.#restoring;
  }
}
