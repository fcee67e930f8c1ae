// What can be done with the keyboard while the map has the focus.

/** Keys and what they do, as the help says it. */
export const KEYS = [
  ["← ↑ → ↓", "move the map"],
  ["+ −", "zoom in and out"],
  ["Enter", "read the values in the middle of the map"],
  ["Esc", "let go of the point"],
  ["0", "show the whole floor"],
  ["1 … 4", "zones, level, slide radii"],
  ["W D X P", "walls, weak direction, expected scan, worst places"],
  ["N", "fly to the next of the worst places"],
];
export const PLAN_KEYS = [["S G", "start or goal in the middle of the map"]];

export const EDIT_KEYS = [
  ["Del", "delete the chosen obstacle, in the tab Edit"],
  ["Ctrl Z, Ctrl Y", "undo and redo, in the tab Edit"],
];

const LAYERS = ["zone", "level", "major_radius", "minor_radius"];
const OVERLAYS = { w: "walls", d: "direction", x: "scan", p: "places" };

/** Show where the focus is while the keyboard is used; Leaflet focuses the map on a click too. */
export function followFocus() {
  const root = document.documentElement;
  document.addEventListener("keydown", () => (root.dataset.keys = ""), true);
  document.addEventListener("pointerdown", () => delete root.dataset.keys, true);
}

/** Listen on the map's element; the shortcuts work there alone. */
export function followKeys(element, floor, store, places) {
  element.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== element) return;
    const key = event.key.toLowerCase();
    const { x, y } = floor.centre;
    if (key === "enter" || key === " ") store.set({ probe: { x, y }, pinned: true });
    else if (key === "escape") store.set({ pinned: false, probe: null });
    else if (key === "0") floor.fit();
    else if (LAYERS[Number(key) - 1] && floor.map.layers.some(({ name }) => name === LAYERS[Number(key) - 1])) store.set({ layer: LAYERS[Number(key) - 1] });
    else if (OVERLAYS[key]) toggle(store, OVERLAYS[key], element);
    else if (key === "n" && places().length) store.set({ place: ((store.get("place") ?? -1) + 1) % places().length });
    else if ((key === "s" || key === "g") && store.get("canPlan")) store.set({ [key === "s" ? "start" : "goal"]: [x, y] });
    else return;
    event.preventDefault();
  });
}

function toggle(store, name, element) {
  const overlays = { ...store.get("overlays"), [name]: !store.get("overlays")[name] };
  store.set({ overlays });
  const box = element.closest(".explorer").querySelector(`input[type=checkbox][name=${name}]`);
  if (box) box.checked = overlays[name];
}
