// The timeline: play, t = 0, the track with its playhead, speed and loop.
//
// Steps are counted from the current step, so t = step * stepS. The playhead runs here
// between two messages of the server, which stays the truth.
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const SCRUB_PAUSE_MS = 40;
  const KEYS = { ArrowLeft: -1, ArrowRight: 1 };

  let axis = { firstStep: -50, lastStep: 59, beginStep: -50, endStep: 59, stepS: 0.1 };
  let head = { step: 0, isPlaying: false, speed: 1, loops: true };
  let since = performance.now();
  let isScrubbing = false;
  let drawAxis = () => {};
  let drawHead = () => {};

  const seconds = (step) => step * axis.stepS;
  const clamped = (step) => Math.min(Math.max(step, axis.firstStep), axis.lastStep);
  // A true minus sign, and a width that does not change with the sign.
  const inWords = (step) =>
    `${step < -0.05 ? "\u2212" : ""}${Math.abs(seconds(step)).toFixed(1)} s`;

  function stepAt(time) {
    if (!head.isPlaying) return head.step;
    const run = ((time - since) / 1000 / axis.stepS) * head.speed;
    const step = head.step + run;
    if (step <= axis.endStep) return step;
    const length = axis.endStep - axis.beginStep;
    if (!head.loops || length <= 0) return axis.endStep;
    return axis.beginStep + ((step - axis.endStep) % length);
  }

  // The step that is shown now, from the current one; other elements keep in time by it.
  pdOverlay.playhead = () => stepAt(performance.now());

  function icon(...shapes) {
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", "0 0 16 16");
    svg.setAttribute("width", "16");
    svg.setAttribute("height", "16");
    for (const [path, isLine] of shapes) {
      const shape = document.createElementNS(SVG, "path");
      shape.setAttribute("d", path);
      shape.setAttribute("fill", isLine ? "none" : "currentColor");
      if (isLine) {
        shape.setAttribute("stroke", "currentColor");
        shape.setAttribute("stroke-width", "1.6");
      }
      svg.appendChild(shape);
    }
    return svg;
  }

  pdOverlay.define("timeline", (api) => {
    const { make } = api;
    const bar = make("div", "pd-solid pd-timeline-bar", {
      role: "group", "aria-label": "Timeline",
    });
    const button = (name, title, event) => {
      const element = make("button", "", { type: "button", "aria-label": name, title });
      element.addEventListener("click", () => api.send(event));
      bar.appendChild(element);
      return element;
    };
    const play = button("Play", "Play or pause (Space)", { kind: "play" });
    const playIcon = icon(["M4 2.5v11l9.5-5.5z"]);
    const pauseIcon = icon(["M3.5 2.5h3v11h-3z"], ["M9.5 2.5h3v11h-3z"]);
    const current = button("t = 0", "Go to t = 0, where edits act", { kind: "current" });
    current.textContent = "t = 0";
    const shown = make("output", "pd-time", { "aria-label": "Time shown" });
    bar.appendChild(shown);
    const track = make("div", "pd-track", {
      role: "slider", "aria-label": "Time", "aria-orientation": "horizontal",
    });
    const lane = make("div", "pd-lane");
    const past = make("div", "pd-past");
    const future = make("div", "pd-future");
    lane.append(past, future);
    const scale = make("div", "pd-scale");
    const knob = make("div", "pd-knob");
    const problems = make("div", "pd-marks");
    const hint = make("div", "pd-solid pd-mark-hint", { role: "tooltip" });
    hint.hidden = true;
    track.append(lane, scale, knob, problems, hint);
    bar.appendChild(track);
    const speed = button("Speed", "Speed of playback", { kind: "speed" });
    speed.classList.add("pd-speed");
    const loop = button("Loop", "Begin again at the end", { kind: "loop" });
    loop.appendChild(icon(
      ["M4.5 5h6.2a2.8 2.8 0 0 1 0 6H4.8a2.8 2.8 0 0 1-2.6-3.8", true],
      ["M6.5 1.8v6.4L2.8 5z"]));
    api.box.appendChild(bar);

    const share = (step) =>
      (100 * (clamped(step) - axis.firstStep)) /
      Math.max(axis.lastStep - axis.firstStep, 1);

    drawAxis = () => {
      const zero = share(0);
      past.style.width = `${zero}%`;
      future.style.left = `${zero}%`;
      future.style.width = `${share(axis.endStep) - zero}%`;
      const perSecond = 1 / axis.stepS;
      const first = Math.ceil(seconds(axis.firstStep) - 1e-6);
      const last = Math.floor(seconds(axis.lastStep) + 1e-6);
      const every = Math.max(1, Math.ceil((last - first) / 24));
      const marks = [];
      for (let second = first; second <= last; second += 1) {
        if (second % every !== 0) continue;
        const mark = make("div", second === 0 ? "pd-second pd-zero" : "pd-second");
        mark.style.left = `${share(second * perSecond)}%`;
        mark.appendChild(make("span", "", {}, String(second).replace("-", "\u2212")));
        marks.push(mark);
      }
      scale.replaceChildren(...marks);
      track.setAttribute("aria-valuemin", seconds(axis.firstStep).toFixed(1));
      track.setAttribute("aria-valuemax", seconds(axis.lastStep).toFixed(1));
    };

    function drawMarks(marks) {
      hint.hidden = true;
      problems.replaceChildren(...marks.map(({ kind, step, text }) => {
        const what = kind === "finding" ? "Finding" : "Problem";
        const mark = make("button", `pd-mark pd-${kind}`, {
          type: "button", "aria-label": `${what} at ${inWords(step)}`,
        });
        mark.style.left = `${share(step)}%`;
        mark.addEventListener("pointerdown", (event) => event.stopPropagation());
        mark.addEventListener("click", () => api.send({ kind, value: step }));
        mark.addEventListener("pointerenter", () => {
          hint.textContent = text;
          hint.hidden = false;
          const part = share(step) / 100;
          const half = hint.offsetWidth / 2;
          const at = Math.min(
            Math.max(part * track.offsetWidth, half - 90),
            track.offsetWidth - half + 90);
          hint.style.left = `${at}px`;
        });
        mark.addEventListener("pointerleave", () => { hint.hidden = true; });
        return mark;
      }));
    }

    let wasPlaying = null;
    let drawnMarks = "";
    drawHead = (step) => {
      window.dispatchEvent(new CustomEvent("pd-playhead", { detail: seconds(step) }));
      knob.style.left = `${share(step)}%`;
      const words = inWords(step);
      if (shown.textContent !== words) {
        shown.textContent = words;
        track.setAttribute("aria-valuenow", seconds(step).toFixed(1));
        track.setAttribute("aria-valuetext", words);
      }
      if (wasPlaying !== head.isPlaying) {
        wasPlaying = head.isPlaying;
        play.setAttribute("aria-label", head.isPlaying ? "Pause" : "Play");
        play.replaceChildren(head.isPlaying ? pauseIcon : playIcon);
      }
      speed.textContent = `${head.speed}\u00d7`;
      loop.setAttribute("aria-pressed", String(head.loops));
    };

    let sent = null;
    let sentAt = 0;
    let late = null;
    function tell(step) {
      clearTimeout(late);
      const wait = sentAt + SCRUB_PAUSE_MS - performance.now();
      if (step === sent) return;
      if (wait > 0) {
        late = setTimeout(() => tell(step), wait);
        return;
      }
      sent = step;
      sentAt = performance.now();
      api.send({ kind: "seek", value: step });
    }
    function scrub(event) {
      const box = track.getBoundingClientRect();
      const part = (event.clientX - box.left) / Math.max(box.width, 1);
      const step = clamped(
        Math.round(axis.firstStep + part * (axis.lastStep - axis.firstStep)));
      head = { ...head, step, isPlaying: false };
      drawHead(step);
      tell(step);
    }
    track.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      isScrubbing = true;
      sent = null;
      track.setPointerCapture(event.pointerId);
      scrub(event);
    });
    track.addEventListener("pointermove", (event) => {
      if (isScrubbing) scrub(event);
    });
    for (const type of ["pointerup", "pointercancel"])
      track.addEventListener(type, () => { isScrubbing = false; });

    // Arrow keys step frames, except where they already mean something. They are taken
    // before viser hears them, whose camera would move.
    api.listen(window, "keydown", (event) => {
      const steps = KEYS[event.key];
      if (!steps || event.ctrlKey || event.metaKey || event.altKey) return;
      const at = event.target;
      if (at?.closest?.("input, textarea, select, [contenteditable], [role=slider], " +
          "[role=tab], [role=option], [role=dialog]")) return;
      event.preventDefault();
      event.stopPropagation();
      api.send({ kind: "step", value: steps * (event.shiftKey ? 10 : 1) });
    }, { capture: true });

    let isAlive = true;
    api.onDispose(() => { isAlive = false; });
    (function run() {
      if (!isAlive) return;
      if (head.isPlaying && !isScrubbing) drawHead(stepAt(performance.now()));
      requestAnimationFrame(run);
    })();

    drawAxis();
    drawHead(head.step);
    return (state) => {
      axis = state;
      drawAxis();
      const marks = JSON.stringify(state);
      if (marks !== drawnMarks) {
        drawnMarks = marks;
        drawMarks(state.marks);
      }
      drawHead(stepAt(performance.now()));
    };
  });

  pdOverlay.define("playhead", () => (state) => {
    if (isScrubbing) return;
    const now = performance.now();
    const gap = state.step - stepAt(now);
    const isRun = state.isPlaying && head.isPlaying && state.speed === head.speed;
    // Messages come late by different times: a small gap is closed bit by bit.
    const step = isRun && Math.abs(gap) < 3 ? state.step - 0.7 * gap : state.step;
    head = { ...state, step };
    since = now;
    drawHead(step);
  });
})();
