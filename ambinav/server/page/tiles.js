// Leaflet layers for the floor: tiles of the service, or a raster of a report.
/* global L */

const TILE = 256;
const MOST_PICTURES = 36;

/**
 * The frame of a map: metres of the map frame are Leaflet's coordinates (lat = y, lng = x), and at
 * zoom `top` one pixel is one cell, counted from the upper left corner.
 */
export function frameOf({ bounds, spacing }, top) {
  const [x0, , , y1] = bounds;
  const side = spacing * 2 ** top;
  return L.extend({}, L.CRS.Simple, {
    transformation: new L.Transformation(1 / side, -x0 / side, -1 / side, y1 / side),
  });
}

/** Levels of a pyramid over so many cells; the service says it of its own. */
export function levelsFor([rows, columns]) {
  return Math.max(0, Math.ceil(Math.log2(Math.max(rows, columns) / TILE))) + 1;
}

const ServedTiles = L.GridLayer.extend({
  initialize(address, source, options) {
    L.setOptions(this, options);
    this.address = address;
    this.source = source;
  },

  createTile(coords, done) {
    const tile = L.DomUtil.create("img", "floor-tile");
    tile.alt = "";
    tile.decoding = "async";
    const address = this.address(coords);
    L.DomEvent.on(tile, "load", () => done(null, tile));
    let failed = false;
    L.DomEvent.on(tile, "error", async () => {
      const again = !failed && !this.source.token && ((await this.source.recovered()) || (await this.source.restored(address)));
      failed = true;
      if (again) tile.src = address;
      else done(new Error(`no tile at ${coords}`), tile);
    });
    if (!this.source.token) {
      tile.src = address;
    } else {
      this.source.fetchPicture(address).then(
        (picture) => {
          L.DomEvent.on(tile, "load error", () => URL.revokeObjectURL(picture));
          tile.src = picture;
        },
        (problem) => done(problem, tile),
      );
    }
    return tile;
  },
});

const RasterTiles = L.GridLayer.extend({
  initialize(picture, options) {
    L.setOptions(this, options);
    this.picture = picture;
  },

  createTile(coords) {
    const tile = L.DomUtil.create("canvas", "floor-tile");
    tile.width = tile.height = TILE;
    const context = tile.getContext("2d");
    // Pixels of the picture that one pixel of the tile covers.
    const step = 2 ** (this.options.top - coords.z);
    context.imageSmoothingEnabled = step > 1;
    context.imageSmoothingQuality = "high";
    const [x, y, side] = [coords.x * TILE * step, coords.y * TILE * step, TILE * step];
    context.drawImage(this.picture, x, y, side, side, 0, 0, TILE, TILE);
    return tile;
  },
});

const shared = (map, top) => {
  const [x0, y0, x1, y1] = map.bounds;
  // A hair within the edge, so that rounding asks for no tile beyond it.
  const hair = 1e-3 * map.spacing;
  return { tileSize: TILE, bounds: L.latLngBounds([y0 + hair, x0 + hair], [y1 - hair, x1 - hair]), noWrap: true, minZoom: -3, maxZoom: top + 6, keepBuffer: 3 };
};

/** Tiles of the service for a layer of a map at a heading. */
export function servedTiles(source, map, layer, top, heading, stat) {
  const address = ({ z, x, y }) => source.tileAddress(map.id, layer, { z, x, y }, heading, stat);
  return new ServedTiles(address, source, {
    ...shared(map, top), minNativeZoom: 0, maxNativeZoom: top, updateWhenZooming: false,
  });
}

/**
 * Tiles of a map at their places in metres, as pictures in a pane: for a lattice that is not that of
 * the frame. Of a large map they are so coarse that they are few.
 */
export function placedTiles(source, map, layer, heading, stat, pane) {
  const [x0, y0, x1, y1] = map.bounds;
  const side = (z) => TILE * map.spacing * 2 ** (map.max_zoom - z);
  const along = (z) => [x1 - x0, y1 - y0].map((length) => Math.ceil(length / side(z) - 1e-6));
  let z = map.max_zoom;
  while (z > 0 && along(z)[0] * along(z)[1] > MOST_PICTURES) z -= 1;
  const [columns, rows] = along(z);
  const group = L.layerGroup();
  for (let at = 0; at < columns * rows; at += 1) {
    const [x, y] = [at % columns, Math.floor(at / columns)];
    const [left, upper] = [x0 + x * side(z), y1 - y * side(z)];
    const box = [[upper - side(z), left], [upper, left + side(z)]];
    const address = source.tileAddress(map.id, layer, { z, x, y }, heading, stat);
    const show = (picture) => {
      const shown = L.imageOverlay(picture, box, { pane, className: "floor-picture" });
      if (source.token) shown.on("load error", () => URL.revokeObjectURL(picture));
      group.addLayer(shown);
    };
    if (source.token) source.fetchPicture(address).then(show, () => {}); // it stays empty, as a tile does
    else show(address);
  }
  return group;
}

/** A coloured raster as tiles. */
export function rasterTiles(picture, map, top) {
  return new RasterTiles(picture, { ...shared(map, top), top, maxNativeZoom: top + 6 });
}
