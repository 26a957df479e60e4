// The row of tools over the picture's top left corner.
import { icon, make } from "../dom.ts";
import { define, guidanceIcons, root } from "../frame.ts";
import type { Tool } from "../messages.ts";

// Drawn on a grid of 20 x 20, to be clear at 16 pixels.
const PATHS: Partial<Record<Tool["icon"], string>> = {
  undo: "M7 4 3 8l4 4M3.5 8H12a4.5 4.5 0 0 1 0 9H8",
  redo: "M13 4l4 4-4 4M16.5 8H8a4.5 4.5 0 0 0 0 9h4",
  "3d": "M10 2.5 17 6v8l-7 3.5L3 14V6zM3 6l7 3.5L17 6M10 9.5v8",
  top: "M2.5 5 7.5 3l5 2 5-2v12l-5 2-5-2-5 2zM7.5 3v12M12.5 5v12",
  fit: "M3 9.5 10 3.5l7 6M5 8v8.5h10V8M8.2 16.5v-5h3.6v5",
  frame: "M3 7V3h4M13 3h4v4M17 13v4h-4M7 17H3v-4M7.5 8.5h5v3h-5z",
  select: "M5 2.5v13l3.4-3.2 2.3 5.2 2.2-1-2.3-5.1h4.6z",
  bend: "M4 17.5c0-8 9-7 9-15M9 17.5c0-6 8-7 8-15M3 6h5M3 6l2-2M3 6l2 2",
  measure: "M2.5 13.5l11-11 4 4-11 11zM5.5 10.5l1.6 1.6M8 8l2.3 2.3M10.5 5.5l1.6 1.6",
  place: "M10 3.5v13M3.5 10h13",
  agents: "M3 5h2M8 5h9M3 10h2M8 10h9M3 15h2M8 15h9",
  scorecard: "M3 16.5V10h3.5v6.5M8.2 16.5V4h3.5v12.5M13.5 16.5V7.5H17v9",
  compare: "M10 3v14M8 5.5H3.5v9H8M12 5.5h4.5v9H12",
  live: "M2 10h3.5l2-5.5 4 11 2.5-7.5 1.2 2H18",
  scenes: "M3 3.5h5.5V9H3zM11.5 3.5H17V9h-5.5zM3 12h5.5v5H3zM11.5 12H17v5h-5.5z",
  help: "M7.2 7.4a2.8 2.8 0 1 1 4.4 2.3c-1 .7-1.6 1.2-1.6 2.5M10 15.2v.4",
};

define("toolbar", (api) => {
  const bar = make("div", "pd-solid pd-bar", { role: "toolbar", "aria-label": "Tools" });
  api.box.append(bar);
  root.prepend(api.box); // The first that Tab comes to.
  const buttons = new Map<string, HTMLButtonElement>();

  function add(tool: Tool): HTMLButtonElement {
    const button = make("button", tool.startsGroup ? "pd-group" : "", { type: "button" });
    const press = () => api.send({ kind: "press", icon: tool.icon });
    const release = () => api.send({ kind: "release", icon: tool.icon });
    button.append(icon(PATHS[tool.icon] ?? guidanceIcons[tool.icon], 20));
    if (tool.isHeld) {
      button.addEventListener("pointerdown", (event) => {
        button.setPointerCapture(event.pointerId);
        press();
      });
      button.addEventListener("lostpointercapture", release);
      button.addEventListener("keydown", (event) => {
        if (event.key === "Enter" && !event.repeat) press();
      });
      button.addEventListener("keyup", (event) => {
        if (event.key === "Enter") release();
      });
    } else button.addEventListener("click", press);
    bar.append(button);
    buttons.set(tool.icon, button);
    return button;
  }

  return ({ tools }) => {
    for (const tool of tools) {
      const button = buttons.get(tool.icon) ?? add(tool);
      button.ariaLabel = button.dataset.hint = tool.hint;
      button.setAttribute("aria-pressed", String(tool.isActive));
      // Not .disabled: a tool keeps the focus, and tells why it cannot be used.
      button.setAttribute("aria-disabled", String(!tool.isEnabled));
    }
  };
});
