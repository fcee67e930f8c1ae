// The data of the page from the HTTP service; embedded_source.js has the same methods.

/** An answer of the service that is an error: RFC 9457 problem details. */
export class Problem extends Error {
  constructor(status, details) {
    super(details.detail ?? details.title ?? `The service answered with status ${status}.`);
    this.status = status;
    this.field = details.field ?? null;
  }
}

const KEY = "ambinav-token";
/** Ids of edited maps are the original's with a mark and a digest. */
const EDITED = /maps\/[A-Za-z0-9_-]*--[0-9a-f]+(\/|$)/;

/** Take the token from the address once, so that it does not stay there. */
function takeToken() {
  // In an address of forms + is a blank; in a token it is a letter.
  const found = new URLSearchParams(location.hash.slice(1).replaceAll("+", "%2B")).get("token");
  if (found) {
    // No header has other letters, and so no token.
    if (/^[\x20-\x7e]+$/.test(found)) sessionStorage.setItem(KEY, found);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return sessionStorage.getItem(KEY);
}

export class HttpSource {
  /** What the page may offer. */
  can = { plan: true, stat: true };
  /** Brings back the edited map that is shown; `edit_sync.js` sets it. */
  restore = null;
  /** Called with false when the connection is lost, and with true when it is back. */
  connection = () => {};
  #back = null;

  constructor(base = "v1") {
    this.base = base;
    this.token = takeToken();
  }

  async maps() {
    return (await this.#json("maps")).maps;
  }

  map(id) {
    return this.#json(`maps/${id}`);
  }

  /** Scale and legend of a layer, and how many levels its tiles have. */
  layer(id, name) {
    return this.#json(`maps/${id}/layers/${name}`);
  }

  /**
   * Address of a tile. `heading` is "mean" or radians; `stat` says what a pixel shows of the cells
   * that it covers: their "mean", or the "worst" of them.
   */
  tileAddress(id, layer, { z, x, y }, heading, stat) {
    const query = new URLSearchParams({ stat });
    if (typeof heading === "number") query.set("theta", heading.toFixed(6));
    return `${this.base}/maps/${id}/layers/${layer}/tiles/${z}/${x}/${y}.png?${query}`;
  }

  /** A picture behind the token, as an address within the page. */
  async fetchPicture(address, signal) {
    const ask = () => this.#fetch(address, { headers: this.#headers(), signal });
    let answer = await ask();
    if (answer.status === 404 && (await this.restored(address))) answer = await ask();
    if (!answer.ok) throw new Problem(answer.status, {});
    return URL.createObjectURL(await answer.blob());
  }

  /** Every layer's value at a pose, its zone, and its cost at a weight. */
  async values(id, x, y, theta, weight) {
    const found = await this.#json(`maps/${id}/values?${this.#pose(x, y, theta)}&weight=${weight}`);
    return { ...found, remark: found.judged && found.zone === null ? `Not counted: ${found.judged}` : null };
  }

  /** The expected scan; null where the map does not keep its scanner. */
  async scan(id, x, y, theta) {
    try {
      return await this.#json(`maps/${id}/scan?${this.#pose(x, y, theta ?? 0)}`);
    } catch (problem) {
      if (problem instanceof Problem && problem.status === 404) return null;
      throw problem;
    }
  }

  worst(id) {
    return this.#json(`maps/${id}/worst`);
  }

  /** Walls, frontiers and reflectors as lines of [x, y]; null where they are too many, and come as tiles. */
  async walls(id) {
    try {
      const found = await this.#json(`maps/${id}/walls.geojson`);
      return wallLines(found);
    } catch (problem) {
      if (problem instanceof Problem && [404, 413].includes(problem.status)) return null;
      throw problem;
    }
  }

  /** Strokes of the weak direction within bounds [x0, y0, x1, y1]. */
  async direction(id, bounds, most, signal) {
    const box = bounds.map((edge) => edge.toFixed(2)).join(",");
    const found = await this.#json(`maps/${id}/direction?bbox=${box}&max=${most}`, { signal });
    const glyphs = Array.isArray(found) ? found : found.glyphs;
    const [x0, y0, x1, y1] = bounds;
    const apart = Math.sqrt(((x1 - x0) * (y1 - y0)) / most);
    return glyphs.map(({ x, y, direction, major, minor }) => ({
      x, y, direction, length: apart * Math.max(major - minor, 0.2),
    }));
  }

  plan(id, request, signal) {
    return this.#json(`maps/${id}/plan`, { method: "POST", body: request, signal });
  }

  pareto(id, request, signal) {
    return this.#json(`maps/${id}/pareto`, { method: "POST", body: request, signal });
  }

  /** Edit a map: obstacles as a FeatureCollection; of a session only the latest is worked out. */
  edit(id, obstacles, options, signal) {
    return this.#json(`maps/${id}/edits?${new URLSearchParams(options)}`, { method: "POST", body: obstacles, signal });
  }

  /** A session of edits: its steps, and the id of its current map. */
  session(id, name) {
    return this.#json(`maps/${id}/sessions/${name}`);
  }

  /** Obstacles of an edited map, as a FeatureCollection. */
  obstacles(id) {
    return this.#json(`maps/${id}/obstacles.geojson`);
  }

  /** The building as GeoJSON. */
  building(id) {
    return this.#json(`maps/${id}/building.geojson`);
  }

  /** Whether an address is that of an edited map which the service had forgotten, and has again. */
  async restored(address) {
    return EDITED.test(address) && this.restore !== null && this.restore();
  }

  /** After something failed: whether the connection was lost, and is back. */
  async recovered() {
    if (await this.#isUp()) return false;
    await this.#untilBack();
    return true;
  }

  /** An answer; while the connection is lost it is asked for again. */
  async #fetch(address, options) {
    for (;;) {
      try {
        return await fetch(address, options);
      } catch (problem) {
        if (!(problem instanceof TypeError)) throw problem; // given up
        await this.#untilBack();
      }
    }
  }

  #untilBack() {
    this.#back ??= (async () => {
      this.connection(false);
      for (let pause = 500; !(await this.#isUp()); pause = Math.min(2 * pause, 5000)) await new Promise((resolve) => setTimeout(resolve, pause));
      this.#back = null;
      this.connection(true);
    })();
    return this.#back;
  }

  #isUp() {
    return fetch(`${this.base}/health`).then((answer) => answer.ok, () => false);
  }

  /** Routes that came with the page. */
  async routes() {
    return [];
  }

  #headers() {
    return this.token ? { Authorization: `Bearer ${this.token}` } : {};
  }

  #pose(x, y, theta) {
    const query = new URLSearchParams({ x: x.toFixed(4), y: y.toFixed(4) });
    if (theta !== null && theta !== undefined) query.set("theta", theta.toFixed(6));
    return query;
  }

  async #json(path, { method = "GET", body = undefined, signal = undefined } = {}) {
    const headers = this.#headers();
    if (body !== undefined) headers["Content-Type"] = "application/json";
    const ask = () => this.#fetch(`${this.base}/${path}`, {
      method, headers, signal, body: body === undefined ? undefined : JSON.stringify(body),
    });
    let answer = await ask();
    if (answer.status === 404 && (await this.restored(path))) answer = await ask();
    if (answer.ok) return answer.json();
    throw new Problem(answer.status, await answer.json().catch(() => ({})));
  }
}

/** The lines of GeoJSON by their kind: of walls, of frontiers, and of the walls that reflect. */
function wallLines({ features }) {
  const of = (kind) => features.filter(({ properties }) => properties.kind === kind).flatMap(({ geometry }) => geometry.coordinates);
  return { walls: of("wall"), frontiers: of("frontier"), reflectors: of("reflector") };
}
