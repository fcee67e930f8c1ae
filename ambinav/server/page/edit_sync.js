// Keeps the map that is shown in step with the obstacles: one request at a time, the latest wins.

import { collectionOf } from "./obstacles.js";

/** While too many others wait, so often is asked again, after so many milliseconds. */
const TRIES = 10;
const PAUSE = 1500;
/** So often is looked whether somebody else has changed the session, in milliseconds. */
const LOOK = 4000;
const CHANGED = "Somebody else has changed these obstacles; this is what they are now. Undo brings yours back.";

export class EditSync {
  #running = null;
  #waiting = false;
  #restoring = null;
  #shown = [];
  /** Step of the session that is shown; null until one is known; and its map as it was last seen. */
  #step = null;
  #current = null;
  #taken = null;
  /** Ids of the maps that this page has edited in a session of its own. */
  #edited = new Set();

  /**
   * `show(id, finished)` shows a version of the map; `finished` is false while something is dragged.
   * `take(features)` puts obstacles that somebody else has put up in the place of those here, and
   * returns the list.
   */
  constructor(source, store, show, take) {
    Object.assign(this, { source, store, show, take });
    const given = new URLSearchParams(location.search).get("session") ?? "";
    this.isNew = !/^[\w-]{1,64}$/.test(given);
    this.editor = `page-${Math.random().toString(36).slice(2)}`;
    this.session = this.isNew ? this.editor : given;
    source.restore = () => this.#restore();
    store.watch(["obstacles"], () => this.#follow());
    store.watch(["original"], () => this.map && store.get("edited") && this.#display());
    setInterval(() => this.#look(), LOOK);
  }

  /** A map was opened: nothing is drawn in it yet. */
  opened(map) {
    this.#running?.abort();
    this.map = map;
    this.#shown = [];
    [this.#step, this.#current] = [null, null];
    this.warm = false;
    this.store.set({ session: this.#hasSession ? this.session : null, edited: null, original: false, trouble: null, working: false });
  }

  /** Features that the session of the page's address has in the map; none in a new session. */
  async kept() {
    if (!this.#hasSession) return [];
    try {
      return await this.#ofSession();
    } catch (problem) {
      this.store.set({ trouble: problem.message });
      return [];
    }
  }

  get #hasSession() {
    return !this.isNew || this.#edited.has(this.map.id);
  }

  /** Step and obstacles of the session, which are those of the page from then on. */
  async #ofSession() {
    const { map } = this;
    const { position, current } = await this.source.session(map.id, this.session);
    const features = current === map.id ? [] : (await this.source.obstacles(current)).features;
    if (map === this.map) [this.#step, this.#current] = [position, current];
    return features;
  }

  /** Show what somebody else has made of the session meanwhile. */
  async #look() {
    const { map, store } = this;
    const isBusy = () => this.#running || store.get("dragging") || map !== this.map;
    if (this.#step === null || document.hidden || isBusy()) return;
    try {
      const before = this.#step;
      const { position, steps } = await this.source.session(map.id, this.session);
      const isMine = steps.some(({ number, editor }) => number === position && editor === this.editor);
      // This page undoes by a step of its own: a step back is somebody else's undo.
      const isOurs = position === before || (isMine && position > before);
      if (!isOurs && this.#step === before && !isBusy()) await this.#yield();
    } catch {
      // The next look, or the next edit, says what is wrong.
    }
  }

  async #yield() {
    this.#taken = this.take(await this.#ofSession());
    this.store.set({ trouble: CHANGED });
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
    const draft = Boolean(store.get("dragging"));
    if (this.#running.signal.aborted) this.#running = new AbortController();
    try {
      const options = { session: this.session, draft, editor: this.editor, ...(draft || this.#step === null ? {} : { after: this.#step }) };
      const found = await this.source.edit(map.id, collectionOf(obstacles), options, this.#running.signal);
      if (map !== this.map) return false;
      if (!draft) {
        store.set({ session: this.session });
        this.#step = found.step;
        this.#edited.add(map.id);
      }
      this.#shown = obstacles;
      const trouble = obstacles === this.#taken ? CHANGED : null;
      store.set({ trouble, ...(obstacles.length ? { edited: found } : { edited: null, original: false }) });
      await this.#display();
    } catch (problem) {
      if (map !== this.map || problem.name === "AbortError") return false;
      if (problem.status !== 409) store.set({ trouble: problem.message });
      // Who may only read sees what the others have made of the session.
      if (problem.status === 403 && this.#current) await this.show(this.#current, true).catch(() => {});
      if (problem.status === 409 && problem.field === "after") await this.#yield();
      // An edit of somebody else has stopped this one; what is dragged is asked for again anyway.
      else if (problem.status === 409) return !draft;
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
