// Drawing obstacles into a map, and the map that there would be; the page of the service alone.

import { EditMarks } from "./edit_marks.js";
import { EditPanel } from "./edit_panel.js";
import { EditSync } from "./edit_sync.js";
import { Obstacles } from "./obstacles.js";

/** Values of the store that belong to edits. */
export const EDIT_VALUES = { obstacles: [], picked: null, tool: "move", dragging: false, edited: null, original: false, trouble: null, working: false };

/** Build the editor into a panel; `show(id, finished)` shows a version of the map. */
export function makeEditor(panel, floor, source, store, show) {
  const obstacles = new Obstacles(store);
  const sync = new EditSync(source, store, show);
  const view = new EditPanel(panel, store, obstacles, source);
  const marks = new EditMarks(floor, store, obstacles, (message) => view.say(message));
  store.watch(["tab", "map"], ({ tab }) => tab === "edit" && sync.prepare());
  floor.element.addEventListener("keydown", (event) => {
    if (event.target !== floor.element || store.get("tab") !== "edit") return;
    const { picked } = store.values;
    if ((event.key === "Delete" || event.key === "Backspace") && picked !== null) obstacles.remove(picked);
    else if (event.key.toLowerCase() === "z") obstacles.undo();
    else if (event.key === "Escape") store.set({ tool: "move", picked: null });
    else return;
    event.preventDefault();
  });
  return {
    opened(map) {
      sync.opened(map);
      obstacles.clear();
      marks.opened();
    },
  };
}
