// Rasters of a report: PNG pictures whose pixels are 16 bits of value and 8 bits of class.

/** Classes after those of the zones; ambinav/reports/page/rasters.py writes them. */
export const UNEXPLORED = 4, UNREACHABLE = 5, OUTSIDE = 6, SOLID = 7, UNKNOWN = 8;
const LEVELS = 65534;

function bytesOf(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

/** Numbers that base64_of() of rasters.py wrote. */
export function numbers(text, Kind) {
  return new Kind(bytesOf(text).buffer);
}

/** A layer that is embedded in the page. */
export class Raster {
  constructor(about, pixels, width, height) {
    Object.assign(this, { about, pixels, width, height });
  }

  /** Decode what a report holds of a layer. */
  static async of(about) {
    const png = new Blob([bytesOf(about.png.split(",")[1])], { type: "image/png" });
    const image = await createImageBitmap(png, { premultiplyAlpha: "none", colorSpaceConversion: "none" });
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [image.width, image.height];
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    return new Raster(about, data, image.width, image.height);
  }

  /** Value of a cell, row 0 at the top; null where there is none. */
  value(row, column) {
    const at = 4 * (row * this.width + column);
    const step = this.pixels[at] * 256 + this.pixels[at + 1];
    const { low, high } = this.about;
    return step > LEVELS ? null : low + (step / LEVELS) * (high - low);
  }

  /** Class of a cell. */
  code(row, column) {
    return this.pixels[4 * (row * this.width + column) + 2];
  }

  /** The layer in its colours, as a canvas; `shades` has the colours of the classes. */
  paint(shades, asZones) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [this.width, this.height];
    const context = canvas.getContext("2d");
    const picture = context.createImageData(this.width, this.height);
    const target = new Uint32Array(picture.data.buffer);
    const classes = shades.map(packed);
    const stripes = packed(shades.stripe);
    const scale = asZones ? null : this.#scale();
    const period = Math.max(4, Math.round(Math.max(this.width, this.height) / 90));
    for (let at = 0, i = 0; i < target.length; i += 1, at += 4) {
      const code = this.pixels[at + 2];
      const diagonal = (i % this.width) + Math.floor(i / this.width);
      if (code === UNEXPLORED && diagonal % period < period / 2) {
        target[i] = stripes;
      } else if (asZones || code >= UNEXPLORED) {
        target[i] = classes[code];
      } else {
        const step = this.pixels[at] * 256 + this.pixels[at + 1];
        target[i] = step > LEVELS ? classes[UNKNOWN] : scale[step >> 6];
      }
    }
    context.putImageData(picture, 0, 0);
    return canvas;
  }

  /** Colours of the steps, 64 of them together. */
  #scale() {
    const { low, high, min, max, log, colours } = this.about;
    const stops = colours.map(packed);
    const table = new Uint32Array(1025);
    for (let i = 0; i < table.length; i += 1) {
      const value = low + ((i * 64 + 32) / LEVELS) * (high - low);
      const share = log ? Math.log(Math.max(value, min) / min) / Math.log(max / min) : (value - min) / (max - min);
      table[i] = between(stops, Math.min(Math.max(share, 0), 1));
    }
    return table;
  }
}

/** "#rrggbb" (or with two more digits of opacity) as a pixel of a little-endian picture. */
function packed(colour) {
  const [r, g, b, a] = [1, 3, 5, 7].map((i) => (colour.length > i ? parseInt(colour.slice(i, i + 2), 16) : 255));
  return ((a << 24) | (b << 16) | (g << 8) | r) >>> 0;
}

function between(stops, share) {
  const place = share * (stops.length - 1);
  const first = Math.min(Math.floor(place), stops.length - 2);
  const part = place - first;
  let mixed = 0;
  for (const shift of [0, 8, 16, 24]) {
    const a = (stops[first] >>> shift) & 255, b = (stops[first + 1] >>> shift) & 255;
    mixed |= Math.round(a + part * (b - a)) << shift;
  }
  return mixed >>> 0;
}
