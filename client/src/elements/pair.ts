// Two samples or branches side by side in top view: one camera and one clock, that of the timeline.
import { button, closeButton, make, option } from "../dom.ts";
import { define, everyFrame } from "../frame.ts";
import { clamp } from "../geometry.ts";
import type { PairSide, ScenePairState } from "../messages.ts";
import { clock } from "../shared.ts";

const COLORS = ["#3d7fe6", "#e06a1b", "#17a08f", "#d6337f"];
const GROUND_COLOR = "rgba(139, 152, 165, 0.4)";

define("pair", (api) => {
  const panel = make("section", "pd-solid pd-pair", { role: "dialog" });
  const sides = ["left", "right"].map((name, place) => {
    const box = make("div", "pd-pair-side");
    const title = make("select", "", { "aria-label": `On the ${name}`, title: "Another one here" });
    title.addEventListener("change", () => api.send({ kind: "choose", side: place, value: Number(title.value) }));
    const use = button("pd-pair-use", "", () => api.send({ kind: "use", value: state?.sides[place].index }));
    const head = make("div", "pd-pair-head");
    const canvas = make("canvas", "", { "aria-label": `Top view, ${name}` });
    head.append(title, use);
    box.append(head, canvas);
    panel.append(box);
    return { title, use, canvas };
  });
  const close = closeButton("Close the comparison", "Esc", () => api.send({ kind: "close" }));
  panel.append(close);
  panel.hidden = true;
  api.box.append(panel);

  let state: ScenePairState | null = null;
  let grounds: Path2D[] = [];
  // The camera that both sides share: the middle in metres, and pixels per metre.
  let view = { x: 0, y: 0, scale: 4 };

  function drawSide(canvas: HTMLCanvasElement, side: PairSide, ground: Path2D, step: number) {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio];
    const pen = canvas.getContext("2d");
    if (!width || !height || !pen) return;
    if (canvas.width !== Math.round(width)) canvas.width = Math.round(width);
    if (canvas.height !== Math.round(height)) canvas.height = Math.round(height);
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    const scale = view.scale * ratio;
    const [left, top] = [canvas.width / 2 - view.x * scale, canvas.height / 2 + view.y * scale];
    pen.setTransform(scale, 0, 0, scale, left, top);
    pen.fillStyle = GROUND_COLOR;
    pen.fill(ground, "evenodd");
    for (const { length, width: across, color, path } of side.agents) {
      const last = path.length / 3 - 1;
      const at = clamp(step, 0, last);
      const first = Math.floor(at);
      const next = Math.min(first + 1, last);
      pen.strokeStyle = pen.fillStyle = COLORS[color];
      pen.globalAlpha = 0.45;
      pen.lineWidth = Math.max(0.4, 1.2 / view.scale);
      pen.beginPath();
      for (let index = first; index <= last; index += 1) pen.lineTo(path[3 * index] / 10, -path[3 * index + 1] / 10);
      pen.stroke();
      pen.globalAlpha = 1;
      const mixed = (part: number) =>
        path[3 * first + part] + (at - first) * (path[3 * next + part] - path[3 * first + part]);
      pen.save();
      pen.translate(mixed(0) / 10, -mixed(1) / 10);
      pen.rotate(-path[3 * first + 2] / 100);
      const [long, wide] = [Math.max(length, 4 / view.scale), Math.max(across, 3 / view.scale)];
      pen.fillRect(-long / 2, -wide / 2, long, wide);
      pen.restore();
    }
  }

  everyFrame(() => {
    if (!state?.isOpen) return;
    const [step, { sides: shown }] = [clock.step(), state];
    sides.forEach(({ canvas }, place) => {
      drawSide(canvas, shown[place], grounds[place], step);
    });
  });

  for (const { canvas } of sides) {
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        const box = canvas.getBoundingClientRect();
        const dx = event.clientX - box.left - box.width / 2;
        const dy = event.clientY - box.top - box.height / 2;
        const scale = clamp(view.scale * Math.exp(-event.deltaY / 500), 0.5, 40);
        const rest = 1 / view.scale - 1 / scale;
        view = { x: view.x + dx * rest, y: view.y - dy * rest, scale };
      },
      { passive: false },
    );
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!canvas.hasPointerCapture(event.pointerId)) return;
      const { x, y, scale } = view;
      view = { x: x - event.movementX / scale, y: y + event.movementY / scale, scale };
    });
  }
  panel.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    api.send({ kind: "close" });
  });

  return (next) => {
    const wasOpen = state?.isOpen;
    state = next;
    panel.hidden = !next.isOpen;
    if (!next.isOpen) return;
    panel.setAttribute("aria-label", `Comparison with another ${next.noun}`);
    grounds = next.sides.map(({ ground }) => new Path2D(ground));
    sides.forEach(({ title, use }, place) => {
      const { index, isAdopted } = next.sides[place];
      title.replaceChildren(...next.offered.map(({ value, text }) => option(value, text)));
      title.value = String(index);
      use.textContent = isAdopted ? "In use" : `Use this ${next.noun}`;
      use.disabled = isAdopted;
    });
    if (wasOpen) return;
    view = { x: 0, y: 0, scale: sides[0].canvas.clientWidth / (2 * next.halfWidth) || 4 };
    close.focus({ preventScroll: true });
  };
});
