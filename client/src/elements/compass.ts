// Where north is, and how long a stretch of road is: a compass and a scale bar.
import { camera, ground, toScene } from "../bridge.ts";
import { button, make, svg } from "../dom.ts";
import { define, onView, pictureSize } from "../frame.ts";
import { type Ground, roundLength } from "../geometry.ts";

const LONGEST_PX = 120;
const STEEP_ENOUGH = 0.2; // Sine of the elevation under which a scale says nothing.

define("compass", (api) => {
  const compass = button("pd-solid pd-compass", "", () => api.send({ kind: "turn" }));
  const dial = svg("svg", "", { viewBox: "0 0 40 40", "aria-hidden": "true" });
  dial.append(
    svg("path", "pd-north", { d: "M20 12.5 24.2 23 20 20.8 15.8 23z" }),
    svg("path", "pd-south", { d: "M20 35 24.2 24.6 20 22.6 15.8 24.6z" }),
    svg("text", "", { x: 20, y: 10.5, "text-anchor": "middle" }, "N"),
  );
  compass.append(dial);
  const scale = make("div", "pd-scalebar", { role: "img" });
  const bar = make("div", "pd-scalebar-line");
  const words = make("div");
  scale.append(bar, words);
  api.box.append(compass, scale);
  let isTop = false;

  function draw() {
    const { width, height } = pictureSize();
    const [left, middle, right] = [-20, 0, 20].map((dx) => ground(width / 2 + dx, height / 2));
    const isSeen = left && right && middle;
    compass.classList.toggle("pd-gone", !isSeen);
    scale.classList.toggle("pd-gone", !isSeen || elevation(middle) < STEEP_ENOUGH);
    if (!isSeen) return;
    const across: Ground = [right[0] - left[0], right[1] - left[1]];
    // Screen right is at this angle of the scene; north is a quarter turn on.
    dial.style.transform = `rotate(${Math.atan2(across[1], across[0])}rad)`;
    const metresPerPixel = Math.hypot(...across) / 40;
    const length = roundLength(LONGEST_PX * metresPerPixel);
    bar.style.width = `${length / metresPerPixel}px`;
    const text = length >= 1000 ? `${length / 1000} km` : `${length} m`;
    // In perspective a length holds where it is measured.
    words.textContent = isTop ? text : `${text} at the centre`;
    scale.setAttribute("aria-label", `Scale: ${words.textContent}`);
  }

  // Its sine, seen from a point of the ground.
  function elevation(middle: Ground): number {
    const seen = camera();
    if (!seen) return 0;
    const eye = toScene(seen.position.clone());
    return eye.z / Math.hypot(eye.x - middle[0], eye.y - middle[1], eye.z);
  }

  onView(draw);
  return (state) => {
    isTop = state.isTop;
    const hint = !isTop
      ? "Compass: turn the view north"
      : state.isHeadingUp
        ? "Compass: focal agent's heading is up. Click for north up"
        : "Compass: north is up. Click for the focal agent's heading up";
    compass.setAttribute("aria-label", hint);
    compass.dataset.hint = hint;
    draw();
  };
});
