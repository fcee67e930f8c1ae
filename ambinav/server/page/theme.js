// Light and dark, and the colours of the table as properties of the page.

import style from "./style.js";

const KEY = "ambinav-theme";

/** Give the page the colours of the one table, as custom properties. */
export function applyColours(root = document.documentElement) {
  for (const { name, colour } of style.zones) root.style.setProperty(`--zone-${name}`, colour);
  for (const name of ["solid", "unreachable", "unknown", "unexplored", "wall", "frontier", "echo", "silent", "slide", "reflector"]) {
    root.style.setProperty(`--${name}`, style[name]);
  }
}

/** Colours of the classes of a raster, in their order, with that of the stripes. */
export function shadesOf(element) {
  const dark = document.documentElement.dataset.theme === "dark";
  // In the dark what is no floor steps back; the floor keeps its colours, which have a meaning.
  const outside = dark ? "#00000000" : `${style.unknown}ff`;
  const solid = dark ? `${style.solid}66` : `${style.solid}ff`;
  const unreachable = dark ? `${style.unreachable}59` : `${style.unreachable}ff`;
  const shades = [...style.zones.map(({ colour }) => colour), style.unknown, unreachable, outside, solid, outside];
  shades.stripe = style.unexplored;
  return shades;
}

/** "light" or "dark": what was chosen, or what the system asks for. */
export function currentTheme() {
  let chosen = null;
  try {
    chosen = localStorage.getItem(KEY);
  } catch {
    // A page from a file may have no storage.
  }
  return chosen ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
}

/** Set the theme, now and for the next visit. */
export function setTheme(theme, store) {
  document.documentElement.dataset.theme = theme;
  store?.set({ theme });
}

/** A button that changes between light and dark. */
export function followTheme(button, store) {
  const show = () => {
    const next = store.get("theme") === "dark" ? "light" : "dark";
    button.setAttribute("aria-label", `Change to ${next} colours`);
    button.title = `Change to ${next} colours`;
  };
  button.addEventListener("click", () => {
    const theme = store.get("theme") === "dark" ? "light" : "dark";
    try {
      localStorage.setItem(KEY, theme);
    } catch {
      // Not kept then.
    }
    setTheme(theme, store);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => setTheme(currentTheme(), store));
  store.watch(["theme"], show);
}
