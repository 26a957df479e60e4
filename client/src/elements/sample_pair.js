// Two samples side by side in top view: one camera and one clock, that of the timeline.
pdOverlay.define("sample-pair", (api) => {
  const { make } = api;
  const panel = make("section", "pd-solid pd-pair", {
    role: "dialog", "aria-label": "Two samples side by side",
  });
  const sides = ["left", "right"].map((name, place) => {
    const box = make("div", "pd-pair-side");
    const title = make("select", "", {
      "aria-label": `Sample on the ${name}`, title: "Another sample here",
    });
    title.addEventListener("change", () =>
      api.send({ kind: "choose", side: place, value: Number(title.value) }));
    const use = make("button", "pd-pair-use", { type: "button" });
    const head = make("div", "pd-pair-head");
    const canvas = make("canvas", "", { "aria-label": `Top view, ${name}` });
    head.append(title, use);
    box.append(head, canvas);
    panel.append(box);
    const side = { title, use, canvas, sample: null };
    use.addEventListener("click", () =>
      api.send({ kind: "use", value: side.sample.index }));
    return side;
  });
  const close = make("button", "pd-close", {
    type: "button", "aria-label": "Close the comparison", title: "Close (Esc)",
  }, "\u00d7");
  close.addEventListener("click", () => api.send({ kind: "close" }));
  panel.append(close);
  panel.hidden = true;
  api.box.append(panel);

  const COLORS = ["#3d7fe6", "#e06a1b", "#17a08f", "#d6337f"];
  let state = { isOpen: false };
  let ground = null;
  // The camera that both sides share: the middle in metres, and pixels per metre.
  let view = { x: 0, y: 0, scale: 4 };

  // Rows are [size, color, flat x y heading ...] in decimetres and hundredths of radians.
  function drawSide({ canvas, sample }, step) {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !sample) return;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio))
      canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    const scale = view.scale * ratio;
    pen.setTransform(scale, 0, 0, scale,
      canvas.width / 2 - view.x * scale, canvas.height / 2 + view.y * scale);
    pen.fillStyle = "rgba(139, 152, 165, 0.4)";
    if (ground) pen.fill(ground, "evenodd");
    for (const { length, width: across, color, path } of sample.agents) {
      const last = path.length / 3 - 1;
      const at = Math.min(Math.max(step, 0), last);
      const first = Math.floor(at);
      const next = Math.min(first + 1, last);
      pen.strokeStyle = pen.fillStyle = COLORS[color];
      pen.globalAlpha = 0.45;
      pen.lineWidth = Math.max(0.4, 1.2 / view.scale);
      pen.beginPath();
      for (let index = first; index <= last; index += 1)
        pen.lineTo(path[3 * index] / 10, -path[3 * index + 1] / 10);
      pen.stroke();
      pen.globalAlpha = 1;
      const share = at - first;
      const mixed = (part) =>
        path[3 * first + part] + share * (path[3 * next + part] - path[3 * first + part]);
      pen.save();
      pen.translate(mixed(0) / 10, -mixed(1) / 10);
      pen.rotate(-path[3 * first + 2] / 100);
      const long = Math.max(length, 4 / view.scale);
      const wide = Math.max(across, 3 / view.scale);
      pen.fillRect(-long / 2, -wide / 2, long, wide);
      pen.restore();
    }
  }

  let isAlive = true;
  api.onDispose(() => { isAlive = false; });
  function run() {
    if (!isAlive || !state.isOpen) return;
    const step = pdOverlay.playhead?.() ?? 0;
    for (const side of sides) drawSide(side, step);
    requestAnimationFrame(run);
  }

  for (const { canvas } of sides) {
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const box = canvas.getBoundingClientRect();
      const [dx, dy] = [
        event.clientX - box.left - box.width / 2, event.clientY - box.top - box.height / 2,
      ];
      const scale = Math.min(Math.max(view.scale * Math.exp(-event.deltaY / 500), 0.5), 40);
      view = {
        x: view.x + dx / view.scale - dx / scale,
        y: view.y - dy / view.scale + dy / scale,
        scale,
      };
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!canvas.hasPointerCapture(event.pointerId)) return;
      view = {
        ...view,
        x: view.x - event.movementX / view.scale,
        y: view.y + event.movementY / view.scale,
      };
    });
  }
  panel.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    api.send({ kind: "close" });
  });

  return (next) => {
    const wasOpen = state.isOpen;
    state = next;
    panel.hidden = !state.isOpen;
    if (!state.isOpen) return;
    ground = new Path2D(state.ground);
    sides.forEach((side, place) => {
      side.sample = state.samples[place];
      side.title.replaceChildren(...state.offered.map(({ index, isAdopted }) =>
        make("option", "", { value: String(index) },
          `Sample ${index + 1}${isAdopted ? ", in use" : ""}`)));
      side.title.value = String(side.sample.index);
      side.use.textContent = side.sample.isAdopted ? "In use" : "Use this sample";
      side.use.disabled = side.sample.isAdopted;
    });
    if (!wasOpen) {
      view = { x: 0, y: 0, scale: sides[0].canvas.clientWidth / (2 * state.halfWidth) || 4 };
      requestAnimationFrame(run);
      close.focus({ preventScroll: true });
    }
  };
});
