// Numbers with units as readers want them; nothing where there is no number.

const known = (value) => typeof value === "number" && Number.isFinite(value);

/** A number with so many digits after the point; a dash where there is none. */
export function number(value, digits = 2) {
  if (value === Infinity) return "∞";
  return known(value) ? value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "−") : "–";
}

/** Metres. */
export const metres = (value, digits = 1) => (known(value) ? `${number(value, digits)}\u00a0m` : "–");

/** A share in percent; none is said to be 0 that is not. */
export const percent = (share) =>
  known(share) ? (share > 0 && share < 0.001 ? "< 0.1" : number(100 * share, share < 0.1 ? 1 : 0)) + "\u00a0%" : "–";

/** Square metres with as many digits as they deserve. */
export const area = (value) =>
  known(value) ? `${value >= 10 ? Math.round(value).toLocaleString("en") : number(value, 1)}\u00a0m²` : "–";

/** A direction without sense, given in radians, as whole degrees from 0 to 179. */
export const axis = (radians) =>
  known(radians) ? `${((Math.round((radians * 180) / Math.PI) % 180) + 180) % 180}°` : "none";

/** An angle in radians as whole degrees. */
export const degrees = (radians) => (known(radians) ? `${Math.round((radians * 180) / Math.PI)}°` : "–");

/** A value of a layer with its unit; shares without one. */
export function quantity(value, units) {
  if (!known(value)) return "–";
  if (units === "rad") return degrees(value);
  if (units === "degrees") return `${Math.round(value)}°`;
  if (units === "1") return number(value);
  const size = Math.abs(value);
  const digits = size >= 100 ? 0 : size >= 10 ? 1 : size >= 0.095 || size === 0 ? 2 : 4;
  return units ? `${number(value, digits)}\u00a0${units}` : number(value, digits);
}

/** A name of a layer as a title: "major_radius" -> "Major radius". */
export function title(name) {
  const text = name.replaceAll("_", " ");
  return text[0].toUpperCase() + text.slice(1);
}

/** A sentence with a capital at its beginning. */
export const sentence = (text) => (text ? text[0].toUpperCase() + text.slice(1) : "");
