// The data of the page from the page itself: a report without a server.
// It has the methods of http_source.js; ambinav/reports/page/map_data.py writes the data.

import { castScan } from "./raycast.js";
import { OUTSIDE, Raster, SOLID, UNEXPLORED, UNREACHABLE, numbers } from "./raster.js";
import style from "./style.js";

export class EmbeddedSource {
  can = { plan: false, stat: false };
  #rasters = new Map();

  constructor(data) {
    this.data = data;
    const { rays } = data;
    this.bounds = data.map.bounds;
    this.wallEnds = numbers(data.walls, Float32Array);
    this.isWall = numbers(data.is_wall, Uint8Array);
    this.isReflector = numbers(data.is_reflector, Uint8Array);
    this.rays = {
      start: numbers(rays.start, Int32Array),
      ...Object.fromEntries(
        ["origin", "angle", "max_range", "max_incidence"].map((name) => [name, numbers(rays[name], Float32Array)]),
      ),
    };
  }

  async maps() {
    const layers = Object.values(this.data.rasters).map(({ png, colours, ...layer }) => layer);
    return [{ ...this.data.map, layers: [...this.data.map.layers, ...layers] }];
  }

  async map() {
    return (await this.maps())[0];
  }

  async layer(id, name) {
    if (name === "zone") return { name };
    const { min, max, log, colours, units, worse } = this.data.rasters[name];
    return { name, min, max, log, units, worse, colours };
  }

  /** The decoded raster of a layer; zones are the classes of any. */
  raster(name) {
    const key = name === "zone" ? "level" : name;
    if (!this.#rasters.has(key)) this.#rasters.set(key, Raster.of(this.data.rasters[key]));
    return this.#rasters.get(key);
  }

  async values(id, x, y) {
    const [x0, , , y1] = this.bounds;
    const { spacing, shape } = this.data.map;
    const [row, column] = [Math.floor((y1 - y) / spacing), Math.floor((x - x0) / spacing)];
    const empty = { x, y, values: {}, zone: null };
    if (row < 0 || column < 0 || row >= shape[0] || column >= shape[1]) return { ...empty, reason: "outside" };
    const code = (await this.raster("zone")).code(row, column);
    if (code > OUTSIDE) return { ...empty, reason: code === SOLID ? "wall" : "unknown" };
    const values = {};
    for (const name of Object.keys(this.data.rasters)) values[name] = (await this.raster(name)).value(row, column);
    const zone = code < UNEXPLORED ? style.zones[code].name : null;
    const remark = { [UNEXPLORED]: "unexplored", [UNREACHABLE]: "out of the robot's reach", [OUTSIDE]: "outside of the building" }[code] ?? null;
    return { x, y, values, zone, remark, reason: null };
  }

  async scan(id, x, y, theta) {
    const [x0, y0] = this.bounds;
    const cast = castScan(this.wallEnds, this.rays, x - x0, y - y0, theta ?? 0);
    return { x: cast.x.map((value) => value + x0), y: cast.y.map((value) => value + y0), hit: cast.hit };
  }

  async worst() {
    return this.data.places ?? [];
  }

  async walls() {
    const [x0, y0] = this.bounds;
    const [walls, frontiers, reflectors] = [[], [], []];
    for (let i = 0; i < this.wallEnds.length; i += 4) {
      const [ax, ay, bx, by] = this.wallEnds.subarray(i, i + 4);
      const line = [[ax + x0, ay + y0], [bx + x0, by + y0]];
      (this.isWall[i / 4] ? walls : frontiers).push(line);
      if (this.isReflector[i / 4]) reflectors.push(line);
    }
    return { walls, frontiers, reflectors };
  }

  async direction() {
    return this.data.direction.map(([x, y, direction, length]) => ({ x, y, direction, length }));
  }

  async routes() {
    return this.data.routes ?? [];
  }
}
