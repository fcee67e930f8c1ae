// Drawing obstacles into a map, and the map that there would be; the page of the service alone.

import { EditMarks } from "./edit_marks.js";
import { EditPanel } from "./edit_panel.js";
import { EditSync } from "./edit_sync.js";
import { Obstacles, obstaclesOf } from "./obstacles.js";

/** Values of the store that belong to edits. */
export const EDIT_VALUES = { session: null, obstacles: [], picked: null, tool: "move", dragging: false, edited: null, original: false, trouble: null, working: false };

/** Build the editor into a panel; `show(id, finished)` shows a version of the map. */
export function makeEditor(panel, floor, source, store, show) {
  const obstacles = new Obstacles(store);
  const sync = new EditSync(source, store, show, (features) => {
    obstacles.replace(obstaclesOf({ features }), "Change by somebody else");
    return obstacles.list;
  });
  const view = new EditPanel(panel, store, obstacles, source);
  const marks = new EditMarks(floor, store, obstacles, (message) => view.say(message));
  store.watch(["tab", "map"], ({ tab }) => tab === "edit" && sync.prepare());
  document.addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase();
    if (store.get("tab") !== "edit" || !(event.ctrlKey || event.metaKey) || event.target.closest("input, select, textarea")) return;
    if (key === "y" || (key === "z" && event.shiftKey)) obstacles.redo();
    else if (key === "z") obstacles.undo();
    else return;
    event.preventDefault();
  });
  floor.element.addEventListener("keydown", (event) => {
    if (event.target !== floor.element || store.get("tab") !== "edit" || event.ctrlKey || event.metaKey) return;
    const { picked } = store.values;
    if ((event.key === "Delete" || event.key === "Backspace") && picked !== null) obstacles.remove(picked);
    else if (event.key.toLowerCase() === "z") obstacles.undo();
    else if (event.key === "Escape") store.set({ tool: "move", picked: null });
    else return;
    event.preventDefault();
  });
  return {
    async opened(map) {
      sync.opened(map);
      obstacles.clear();
      marks.opened();
      const kept = await sync.kept();
      if (kept.length && map === sync.map) obstacles.replace(obstaclesOf({ features: kept }));
    },
  };
}
