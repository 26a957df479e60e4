/* Built by .ci/client.py from client/ (b639318741cf26d1); not to be edited. */
"use strict";
(() => {
  // src/clock.ts
  var secondsOf = (step, axis) => step * axis.stepS;
  function inWords(step, axis) {
    const seconds = Math.abs(secondsOf(step, axis)).toFixed(1);
    return `${step < 0 && seconds !== "0.0" ? "−" : ""}${seconds} s`;
  }
  function stepAfter(seconds, head2, { beginStep, endStep, stepS }) {
    if (!head2.isPlaying) return head2.step;
    const step = head2.step + seconds / stepS * head2.speed;
    const sign = Math.sign(head2.speed);
    const [ahead, behind] = sign > 0 ? [endStep, beginStep] : [beginStep, endStep];
    const passed = sign * (step - ahead);
    if (passed <= 0) return step;
    const length = endStep - beginStep;
    return !head2.loops || length <= 0 ? ahead : behind + sign * (passed % length);
  }

  // src/dom.ts
  function dressed(element, className, attributes, text) {
    if (className) element.setAttribute("class", className);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
    if (text) element.textContent = text;
    return element;
  }
  function make(tag, className = "", attributes = {}, text = "") {
    return dressed(document.createElement(tag), className, attributes, text);
  }
  function svg(tag, className = "", attributes = {}, text = "") {
    const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
    return dressed(element, className, attributes, text);
  }
  function icon(path, grid, className = "") {
    const picture = svg("svg", className, { viewBox: `0 0 ${grid} ${grid}`, "aria-hidden": "true" });
    picture.append(svg("path", "", { d: path }));
    return picture;
  }
  function button(className, text, act, attributes = {}) {
    const element = make("button", className, { type: "button", ...attributes }, text);
    element.addEventListener("click", act);
    return element;
  }
  var option = (value, text) => make("option", "", { value }, text);
  var within = (event, selector) => event.target instanceof Element ? event.target.closest(selector) : null;
  var isTyping = (event) => within(event, "input, textarea, select, [contenteditable]") !== null;
  var hasModifier = (event) => event.ctrlKey || event.metaKey || event.altKey;

  // src/geometry.ts
  var distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  var clamp = (value, low, high) => Math.min(Math.max(value, low), high);

  // src/player/camera.ts
  var PIXELS_PER_M = [0.2, 200];
  var LEAST_SPAN_M = 20;
  var SLANT = 0.95;
  var Camera = class {
    /** The place in the middle of the picture. */
    middle = [0, 0];
    scale = 4;
    turn = 0;
    /** From 0, above, to a right angle, at eye level. */
    slant = 0;
    width = 1;
    height = 1;
    /** Of a canvas in metres on the ground, as its setTransform takes it. */
    matrix(ratio) {
      const [cos, sin] = [Math.cos(this.turn) * this.scale, Math.sin(this.turn) * this.scale];
      const flat = Math.cos(this.slant);
      const [x, y] = this.middle;
      const [a, b, c, d] = [cos, -flat * sin, -sin, -flat * cos];
      const [e, f] = [this.width / 2 - a * x - c * y, this.height / 2 - b * x - d * y];
      return [a * ratio, b * ratio, c * ratio, d * ratio, e * ratio, f * ratio];
    }
    /** Pixels by which something rises above its place on the ground. */
    rise(height) {
      return height * this.scale * Math.sin(this.slant);
    }
    pixel([x, y]) {
      const [a, b, c, d, e, f] = this.matrix(1);
      return [a * x + c * y + e, b * x + d * y + f];
    }
    ground([x, y]) {
      const [a, b, c, d, e, f] = this.matrix(1);
      const determinant = a * d - b * c;
      return [(d * (x - e) - c * (y - f)) / determinant, (a * (y - f) - b * (x - e)) / determinant];
    }
    /** Move the picture so that a place of the ground is at a pixel. */
    hold(place2, pixel) {
      const now = this.ground(pixel);
      this.middle = [this.middle[0] + place2[0] - now[0], this.middle[1] + place2[1] - now[1]];
    }
    zoom(factor, pixel) {
      const place2 = this.ground(pixel);
      this.scale = clamp(this.scale * factor, ...PIXELS_PER_M);
      this.hold(place2, pixel);
    }
    /** Show an area, with room for what lies over the edges of the picture. */
    fit([low, high], edges) {
      const [width, height] = [this.width - edges.left - edges.right, this.height - edges.top - edges.bottom];
      this.turn = 0;
      const across = Math.max(high[0] - low[0], LEAST_SPAN_M);
      const up = Math.max(high[1] - low[1], LEAST_SPAN_M) * Math.cos(this.slant);
      this.scale = clamp(0.92 * Math.min(width / across, height / up), ...PIXELS_PER_M);
      const pixel = [edges.left + width / 2, edges.top + height / 2];
      this.hold([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2], pixel);
    }
  };

  // src/player/scene.ts
  var SCALES = [100, 100, 1e3, 100];
  function summed(changes, scale) {
    let sum = 0;
    return changes.map((change) => {
      sum += change;
      return sum / scale;
    });
  }
  function line(changes) {
    let [x, y] = [0, 0];
    return Array.from({ length: changes.length / 2 }, (_, index) => {
      x += changes[2 * index];
      y += changes[2 * index + 1];
      return [x / SCALES[0], y / SCALES[1]];
    });
  }
  var agentOf = (packed) => ({
    ...packed,
    size: [packed.size[0] / 100, packed.size[1] / 100, packed.size[2] / 100],
    runs: packed.runs.map(([first, ...columns]) => ({
      first,
      columns: columns.map((column, index) => summed(column, SCALES[index]))
    }))
  });
  function unpacked(packed) {
    const { original: original2 } = packed;
    return {
      ...packed,
      road: packed.road.map((layer) => ({ ...layer, lines: layer.lines.map(line) })),
      signals: packed.signals.map((signal) => ({ ...signal, line: line(signal.line) })),
      agents: packed.agents.map(agentOf),
      original: original2 && { lines: original2.lines.map(line), agents: original2.agents.map(agentOf) }
    };
  }
  async function read(base64) {
    const bytes = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
    const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return unpacked(await new Response(inflated).json());
  }
  function poseAt({ runs }, step) {
    const run = runs.findLast(({ first }) => first <= step);
    if (!run) return null;
    const last = run.columns[0].length - 1;
    if (step - run.first > last) return null;
    const index = Math.floor(step - run.first);
    const share = step - run.first - index;
    const [x, y, heading, speed2] = run.columns.map(
      (column) => column[index] + share * (column[Math.min(index + 1, last)] - column[index])
    );
    return { at: [x, y], heading, speed: speed2 };
  }
  function waysOf({ runs }, from, to) {
    return runs.map(({ first, columns: [x, y] }) => {
      const inside = x.map((_, index) => index).filter((index) => first + index >= from && first + index <= to);
      return inside.map((index) => [x[index], y[index]]);
    });
  }
  function colorAt(phases, step) {
    return (phases.findLast(([first]) => first <= step + 1e-6) ?? phases[0])[1];
  }
  function boundsOf(scene2) {
    const places = scene2.agents.flatMap((agent) => waysOf(agent, scene2.first, scene2.last).flat());
    const points = places.length ? places : scene2.road.flatMap((layer) => layer.lines.flat());
    const low = [Infinity, Infinity];
    const high = [-Infinity, -Infinity];
    for (const point of points.length ? points : [[0, 0]])
      for (const axis of [0, 1]) {
        low[axis] = Math.min(low[axis], point[axis]);
        high[axis] = Math.max(high[axis], point[axis]);
      }
    return [low, high];
  }

  // src/player/drawing.ts
  var TRAIL_S = 3;
  var LEAST_PIXELS = 3;
  var ARROW_EVERY_M = 1.4;
  var STOP_LINE_M = 0.5;
  var MOST_SLICES = 40;
  var IN_SHADE = 0.62;
  var paths = /* @__PURE__ */ new WeakMap();
  function pathOf(key, lines, isClosed) {
    let path = paths.get(key);
    if (!path) {
      path = new Path2D();
      for (const line2 of lines) {
        line2.forEach(([x, y], index) => {
          if (index) path?.lineTo(x, y);
          else path?.moveTo(x, y);
        });
        if (isClosed) path.closePath();
      }
      paths.set(key, path);
    }
    return path;
  }
  function arrowsOf({ lines }) {
    return lines.flatMap((line2) => {
      const at = Math.floor(line2.length / 2);
      const [from, to] = [line2[at - 1], line2[at]];
      if (!from) return [];
      const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
      if (!length) return [];
      const [dx, dy] = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
      const tail = (side) => [
        to[0] - ARROW_EVERY_M * dx - side * dy,
        to[1] - ARROW_EVERY_M * dy + side * dx
      ];
      return [[tail(0.45), to, tail(-0.45)]];
    });
  }
  function drawRoad(pen, scene2, camera2, look2) {
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.fillStyle = scene2.colors.ground[look2.theme];
    pen.fillRect(0, 0, pen.canvas.width, pen.canvas.height);
    pen.setTransform(...camera2.matrix(look2.ratio));
    const atLeast = (width, pixels) => Math.max(width, pixels / camera2.scale);
    for (const layer of scene2.road) {
      pen.fillStyle = pen.strokeStyle = layer.colors[look2.theme];
      if (layer.isArrow) {
        if (camera2.scale < 2) continue;
        pen.fill(pathOf(layer, arrowsOf(layer), true));
      } else if (layer.width) {
        pen.lineWidth = atLeast(layer.width, 0.6);
        const [on, off, begin2] = layer.dash ?? [];
        pen.setLineDash(layer.dash ? [on, off] : []);
        pen.lineDashOffset = begin2 ?? 0;
        pen.stroke(pathOf(layer, layer.lines, false));
        pen.setLineDash([]);
      } else {
        for (const ring of layer.lines) pen.fill(pathOf(ring, [ring], true), "evenodd");
      }
    }
    if (scene2.original && look2.compares) {
      pen.strokeStyle = scene2.colors.ghost[look2.theme];
      pen.lineWidth = atLeast(0.1, 1);
      pen.stroke(pathOf(scene2.original, scene2.original.lines, false));
    }
  }
  function drawTraffic(pen, scene2, camera2, look2, step) {
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, pen.canvas.width, pen.canvas.height);
    const matrix = camera2.matrix(look2.ratio);
    pen.setTransform(...matrix);
    pen.lineCap = "butt";
    for (const { line: line2, phases } of scene2.signals) {
      pen.strokeStyle = colorAt(phases, step)[look2.theme];
      pen.lineWidth = Math.max(STOP_LINE_M, 2 / camera2.scale);
      stroke(pen, line2);
    }
    const shown2 = there(scene2.agents, step);
    pen.lineCap = pen.lineJoin = "round";
    for (const { agent, pose } of shown2) {
      pen.strokeStyle = agent.colors[look2.theme];
      const isChosen = agent.id === look2.chosen;
      const to = isChosen ? scene2.last : step + TRAIL_S / scene2.stepS;
      pen.globalAlpha = isChosen ? 0.7 : 0.4;
      pen.lineWidth = Math.max(isChosen ? 0.4 : 0.3, 1.5 / camera2.scale);
      waysOf(agent, step, to).forEach((way) => {
        const isNext = way.length && Math.hypot(way[0][0] - pose.at[0], way[0][1] - pose.at[1]) < pose.speed + 1;
        stroke(pen, isNext ? [pose.at, ...way] : way);
      });
    }
    pen.globalAlpha = 1;
    const depth = ({ pose }) => camera2.pixel(pose.at)[1];
    const sorted = camera2.slant ? shown2.toSorted((one, other2) => depth(one) - depth(other2)) : shown2;
    for (const one of sorted) drawAgent(pen, matrix, one, camera2, look2, scene2);
    for (const { agent, pose } of look2.compares && scene2.original ? there(scene2.original.agents, step) : []) {
      place(pen, matrix, pose, 0);
      pen.strokeStyle = scene2.colors.ghost[look2.theme];
      pen.lineWidth = Math.max(0.15, 1.5 / camera2.scale);
      const [length, width] = agent.size;
      pen.strokeRect(-length / 2, -width / 2, length, width);
    }
    return shown2;
  }
  var there = (agents, step) => agents.flatMap((agent) => {
    const pose = poseAt(agent, step);
    return pose ? [{ agent, pose }] : [];
  });
  function stroke(pen, line2) {
    if (line2.length < 2) return;
    pen.beginPath();
    for (const [x, y] of line2) pen.lineTo(x, y);
    pen.stroke();
  }
  function shade(color) {
    const part = (begin2) => Math.round(IN_SHADE * Number.parseInt(color.slice(begin2, begin2 + 2), 16));
    return `rgb(${part(1)}, ${part(3)}, ${part(5)})`;
  }
  function place(pen, matrix, { at, heading }, rise) {
    const [a, b, c, d, e, f] = matrix;
    pen.setTransform(a, b, c, d, e, f - rise);
    pen.translate(...at);
    pen.rotate(heading);
  }
  function drawAgent(pen, matrix, { agent, pose }, camera2, look2, scene2) {
    const least = LEAST_PIXELS / camera2.scale;
    const [length, width] = [Math.max(agent.size[0], least), Math.max(agent.size[1], least)];
    const rise = camera2.rise(agent.size[2]) * look2.ratio;
    const isLong = length > 1.5 * width;
    const body = (grown = 0) => {
      pen.beginPath();
      const [l, w] = [length + 2 * grown, width + 2 * grown];
      if (length > 1.3) pen.roundRect(-l / 2, -w / 2, l, w, 0.25 * w);
      else pen.ellipse(0, 0, l / 2, w / 2, 0, 0, 7);
    };
    if (agent.id === look2.chosen || agent.id === look2.hovered) {
      place(pen, matrix, pose, 0);
      const pixel = 1 / camera2.scale;
      for (const [name, grown] of [
        ["selection_rim", 4],
        ["selection", 3]
      ]) {
        pen.fillStyle = scene2.colors[name][look2.theme];
        body(grown * pixel);
        pen.fill();
      }
    }
    const color = agent.colors[look2.theme];
    pen.fillStyle = shade(color);
    for (let part = 0; part < rise; part += Math.max(look2.ratio, rise / MOST_SLICES)) {
      place(pen, matrix, pose, part);
      body();
      pen.fill();
    }
    pen.fillStyle = color;
    place(pen, matrix, pose, rise);
    body();
    pen.fill();
    if (isLong && length * camera2.scale > 12) {
      pen.fillStyle = scene2.colors.glass[look2.theme];
      pen.globalAlpha = 0.75;
      const front = length / 2 - Math.min(0.24 * length, 1.2);
      const depth = Math.min(0.13 * length, 0.7);
      pen.beginPath();
      for (const [x, y] of [
        [front, 0.42],
        [front - depth, 0.34],
        [front - depth, -0.34],
        [front, -0.42]
      ])
        pen.lineTo(x, y * width);
      pen.fill();
      pen.globalAlpha = 1;
    }
  }

  // src/player/main.ts
  var SPEEDS = [0.25, 0.5, 1, 2, 4];
  var ZOOM_STEP = 1.25;
  var TURN_PER_PIXEL = 6e-3;
  var MOST_SLANT = 1.3;
  var CLICK_PIXELS = 5;
  var NEAR_M = 50;
  var KEYS = [
    ["Space, K", "play or pause"],
    [", .  ← →", "a frame back or on; with Shift ten"],
    ["J L", "a second back or on"],
    ["F", "follow the selected agent"],
    ["N", "select the next agent"],
    ["Home", "show all"],
    ["V", "from above, or at a slant"],
    ["O", "compare with the original"],
    ["Page ↑ ↓", "another scene"],
    ["+ −, wheel", "zoom; drag moves, with Shift turns"]
  ];
  var entries = JSON.parse(document.getElementById("scenes")?.textContent ?? "[]");
  var isPair = document.body.hasAttribute("data-pair");
  var camera = new Camera();
  var look = { theme: 0, ratio: 1, chosen: null, hovered: null, compares: false };
  var scene = null;
  var other = null;
  var otherCamera = new Camera();
  var otherShown = [];
  var shift = [0, 0];
  var number = 0;
  var head = { step: 0, isPlaying: !matchMedia("(prefers-reduced-motion: reduce)").matches, speed: 1, loops: true };
  var since = performance.now();
  var shown = [];
  var follows = false;
  var isRoadOld = true;
  var isTrafficOld = true;
  var stage = make("main", "pd-stage", { "aria-label": "Top view of the scene" });
  var [road, traffic, otherRoad, otherTraffic] = [make("canvas"), make("canvas"), make("canvas"), make("canvas")];
  var otherTitle = make("h1");
  var otherLabel = make("div", "pd-label", { role: "note" });
  var title = make("h1");
  var facts = make("p");
  var credit = make("p", "pd-credit");
  var labels = [make("div", "pd-label", { role: "note" }), make("div", "pd-label", { role: "note" })];
  var about = make("section", "pd-about", { "aria-label": "About" });
  var list = make("nav", "pd-list", { "aria-label": "Scenes" });
  var playIcon = icon("M4 2.5v11l9.5-5.5z", 16);
  var pauseIcon = icon("M3.5 2.5h3v11h-3z M9.5 2.5h3v11h-3z", 16);
  var play = button("", "", () => setPlaying(!head.isPlaying), { title: "Play or pause (Space)" });
  var time = make("output", "pd-time", { "aria-label": "Time shown" });
  var slider = make("input", "", { type: "range", step: 1, "aria-label": "Time" });
  var zero = make("div", "pd-zero", { title: "t = 0" });
  var speed = make("select", "", { "aria-label": "Speed" });
  var follow = button("", "Follow", () => setFollows(!follows), { title: "Follow the selected agent (F)" });
  var slant = button("", "3-D", toggleSlant, { title: "From above, or at a slant (V)" });
  var original = button("", "Original", toggleOriginal, { title: "Compare with the original (O)" });
  var info = button("", "About", toggleAbout, { title: "Source and keys (?)" });
  function build() {
    const top = make("header", "pd-head");
    top.append(title, facts);
    about.hidden = true;
    const beside = make("header", "pd-head");
    beside.append(otherTitle);
    const others = isPair ? [otherRoad, otherTraffic, beside, otherLabel] : [];
    stage.append(road, traffic, top, credit, ...others, ...labels, about);
    for (const value of SPEEDS) speed.append(option(value, `${value}×`));
    speed.value = "1";
    const track = make("div", "pd-track");
    track.append(slider, zero);
    const tools = make("div", "pd-tools");
    tools.append(follow, button("", "Fit", fit, { title: "Show all (Home)" }), slant, original, info);
    const bar = make("footer", "pd-bar");
    bar.append(play, time, track, speed, tools);
    entries.forEach((entry, index) => {
      list.append(button("", entry.name, () => open(index)));
    });
    list.hidden = isPair || entries.length < 2;
    document.body.append(list, stage, bar);
  }
  var stepNow = () => scene ? stepAfter((performance.now() - since) / 1e3, head, { ...scene, beginStep: begin(scene), endStep: end(scene) }) : 0;
  var otherStep = (step, from, to) => to.current + (step - from.current) * from.stepS / to.stepS;
  var begin = (one) => Math.min(one.first, other ? Math.ceil(otherStep(other.first, other, one)) : one.first);
  var end = (one) => Math.max(one.last, other ? Math.floor(otherStep(other.last, other, one)) : one.last);
  function seek(step, change = {}) {
    head = { ...head, ...change, step: scene ? clamp(step, begin(scene), end(scene)) : 0 };
    since = performance.now();
    isTrafficOld = true;
    play.replaceChildren(head.isPlaying ? pauseIcon : playIcon);
    play.setAttribute("aria-label", head.isPlaying ? "Pause" : "Play");
  }
  var setPlaying = (isPlaying) => seek(isPlaying ? stepNow() : Math.round(stepNow()), { isPlaying });
  var skip = (steps) => seek(Math.round(stepNow()) + steps, { isPlaying: false });
  function setFollows(value) {
    follows = value;
    if (follows && !look.chosen) choose(scene?.focus || shown[0]?.agent.id || null);
    pressed(follow, follows);
  }
  function choose(id) {
    look.chosen = id;
    if (!id && follows) setFollows(false);
    isTrafficOld = true;
  }
  function chooseNext() {
    const index = shown.findIndex(({ agent }) => agent.id === look.chosen);
    choose(shown[(index + 1) % shown.length]?.agent.id ?? null);
  }
  function toggleSlant() {
    camera.slant = camera.slant ? 0 : SLANT;
    pressed(slant, camera.slant > 0);
    isRoadOld = true;
  }
  function toggleOriginal() {
    look.compares = !look.compares && !original.hidden;
    pressed(original, look.compares);
    isRoadOld = true;
  }
  function toggleAbout() {
    about.hidden = !about.hidden;
    pressed(info, !about.hidden);
  }
  var pressed = (one, is) => one.setAttribute("aria-pressed", String(is));
  var fitted = "";
  var viewNow = () => [camera.middle, camera.scale, camera.turn].join();
  function fit() {
    if (!scene) return;
    setFollows(false);
    camera.fit(boundsOf(scene), { top: 64, bottom: 32, left: 16, right: 16 });
    fitted = viewNow();
    isRoadOld = true;
  }
  async function open(index) {
    number = index;
    const entry = entries[index];
    [...list.children].forEach((one, at) => {
      one.setAttribute("aria-current", String(at === index));
    });
    list.children[index]?.scrollIntoView({ block: "nearest", inline: "nearest" });
    title.textContent = entry.name;
    let found;
    try {
      found = await read(entry.data);
      if (isPair) other = await read(entries[1].data);
    } catch (error) {
      facts.textContent = `This browser cannot read the scene: ${error}`;
      return;
    }
    if (number !== index) return;
    scene = found;
    if (other) {
      const [here, there2] = [middleOf(scene), middleOf(other)];
      shift = distance(here, there2) > NEAR_M ? [there2[0] - here[0], there2[1] - here[1]] : [0, 0];
      otherTitle.textContent = entries[1].name;
    }
    choose(null);
    look.hovered = null;
    const [from, to] = [begin(found), end(found)];
    const duration = ((to - from) * found.stepS).toFixed(1);
    facts.textContent = [found.city, `${found.agents.length} agents`, `${duration} s`].filter(Boolean).join(" · ");
    credit.textContent = found.attribution;
    slider.min = String(from);
    slider.max = String(to);
    zero.style.left = `${100 * (found.current - from) / Math.max(to - from, 1)}%`;
    original.hidden = !(found.original || other?.original);
    if (original.hidden) look.compares = false;
    pressed(original, look.compares);
    const keys = make("dl");
    for (const [key, what] of KEYS) keys.append(make("dt", "", {}, key), make("dd", "", {}, what));
    about.replaceChildren(
      ...[found.attribution, ...found.notes].filter(Boolean).map((text) => make("p", "", {}, text)),
      keys
    );
    seek(from);
    fit();
  }
  function middleOf(one) {
    const focus = one.agents.find(({ id }) => id === one.focus);
    const [low, high] = boundsOf(one);
    return (focus && poseAt(focus, one.current)?.at) ?? [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
  }
  function resize() {
    look.ratio = window.devicePixelRatio || 1;
    const { width: whole, height } = stage.getBoundingClientRect();
    const width = isPair ? whole / 2 : whole;
    const wasFitted = viewNow() === fitted;
    [camera.width, camera.height] = [width, height];
    for (const canvas of [road, traffic, otherRoad, otherTraffic]) {
      canvas.width = Math.round(width * look.ratio);
      canvas.height = Math.round(height * look.ratio);
    }
    isRoadOld = true;
    if (wasFitted) fit();
  }
  function showLabel(label, id, among = shown, from = camera, left0 = 0) {
    const found = among.find(({ agent: agent2 }) => agent2.id === id);
    label.hidden = !found;
    if (!found) return;
    const { agent, pose } = found;
    label.textContent = `${agent.id}
${agent.kind} · ${pose.speed.toFixed(1)} m/s`;
    const [x, y] = from.pixel(pose.at);
    const side = agent.size[0] / 2 * camera.scale + 8;
    const left = clamp(x + Math.min(side, 40), 4, camera.width - label.offsetWidth - 4);
    const above = y - camera.rise(agent.size[2]) - Math.min(side, 40) - label.offsetHeight;
    label.style.transform = `translate(${left0 + left}px, ${clamp(above, 4, camera.height - label.offsetHeight - 4)}px)`;
  }
  function frame() {
    requestAnimationFrame(frame);
    if (!scene || !(head.isPlaying || isRoadOld || isTrafficOld)) return;
    const step = stepNow();
    const followed = follows && scene.agents.find(({ id }) => id === look.chosen);
    const pose = followed && poseAt(followed, step);
    if (pose) {
      camera.middle = pose.at;
      isRoadOld = true;
    }
    shown = draw(road, traffic, scene, camera, step);
    if (other) {
      Object.assign(otherCamera, camera, { middle: [camera.middle[0] + shift[0], camera.middle[1] + shift[1]] });
      otherShown = draw(otherRoad, otherTraffic, other, otherCamera, otherStep(step, scene, other));
    }
    isRoadOld = isTrafficOld = false;
    slider.value = String(step);
    const words = inWords(step - scene.current, scene);
    if (time.textContent !== words) {
      time.textContent = words;
      slider.setAttribute("aria-valuetext", words);
    }
    showLabel(labels[0], look.chosen);
    showLabel(labels[1], look.hovered === look.chosen ? null : look.hovered);
    if (other) showLabel(otherLabel, look.hovered ?? look.chosen, otherShown, otherCamera, camera.width);
  }
  function draw(under, over, of, from, step) {
    const [pen, above] = [under.getContext("2d"), over.getContext("2d")];
    if (!pen || !above) return [];
    if (isRoadOld) drawRoad(pen, of, from, look);
    return drawTraffic(above, of, from, look, step);
  }
  function agentAt(pixel, reach) {
    const [among, from] = isOther ? [otherShown, otherCamera] : [shown, camera];
    const hits = among.flatMap(({ agent, pose: { at, heading } }) => {
      const place2 = from.ground([pixel[0], pixel[1] + camera.rise(agent.size[2]) / 2]);
      const [dx, dy] = [place2[0] - at[0], place2[1] - at[1]];
      const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
      const [along, across] = [Math.abs(dx * cos + dy * sin), Math.abs(dy * cos - dx * sin)];
      const gap = Math.hypot(Math.max(0, along - agent.size[0] / 2), Math.max(0, across - agent.size[1] / 2));
      return gap * camera.scale <= reach ? [{ id: agent.id, gap: gap + 0.01 * Math.hypot(dx, dy) }] : [];
    });
    return hits.toSorted((one, other2) => one.gap - other2.gap)[0]?.id ?? null;
  }
  var pointers = /* @__PURE__ */ new Map();
  var moved = 0;
  var isOther = false;
  var pixelOf = (event) => {
    const { left, top } = stage.getBoundingClientRect();
    const x = event.clientX - left;
    if (!pointers.size) isOther = isPair && x >= camera.width;
    return [isOther ? x - camera.width : x, event.clientY - top];
  };
  var onPicture = (event) => !within(event, ".pd-about");
  stage.addEventListener("pointerdown", (event) => {
    if (!onPicture(event)) return;
    stage.setPointerCapture(event.pointerId);
    if (!pointers.size) moved = 0;
    pointers.set(event.pointerId, pixelOf(event));
  });
  stage.addEventListener("pointermove", (event) => {
    const [before, now] = [pointers.get(event.pointerId), pixelOf(event)];
    if (!before) {
      const hovered = event.pointerType === "mouse" && onPicture(event) ? agentAt(now, 4) : null;
      isTrafficOld ||= hovered !== look.hovered;
      look.hovered = hovered;
      stage.classList.toggle("pd-points", hovered !== null);
      return;
    }
    moved += distance(before, now);
    const other2 = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
    pointers.set(event.pointerId, now);
    if (moved < CLICK_PIXELS) return;
    if (other2) {
      const middle = (one) => [(one[0] + other2[0]) / 2, (one[1] + other2[1]) / 2];
      camera.hold(camera.ground(middle(before)), middle(now));
      camera.zoom(distance(now, other2) / Math.max(distance(before, other2), 1), middle(now));
    } else if (event.shiftKey || event.buttons === 2) {
      camera.turn += TURN_PER_PIXEL * (now[0] - before[0]);
      if (camera.slant) camera.slant = clamp(camera.slant - TURN_PER_PIXEL * (now[1] - before[1]), 0.05, MOST_SLANT);
    } else {
      setFollows(false);
      camera.hold(camera.ground(before), now);
    }
    isRoadOld = true;
  });
  for (const type of ["pointerup", "pointercancel"])
    stage.addEventListener(type, (event) => {
      if (!pointers.delete(event.pointerId) || moved >= CLICK_PIXELS || type === "pointercancel") return;
      choose(agentAt(pixelOf(event), event.pointerType === "mouse" ? 4 : 14));
    });
  stage.addEventListener("pointerleave", () => {
    look.hovered = null;
    isTrafficOld = true;
  });
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener(
    "wheel",
    (event) => {
      if (!onPicture(event)) return;
      event.preventDefault();
      const pixel = follows ? [camera.width / 2, camera.height / 2] : pixelOf(event);
      camera.zoom(1.0015 ** -(event.deltaMode ? 30 * event.deltaY : event.deltaY), pixel);
      isRoadOld = true;
    },
    { passive: false }
  );
  slider.addEventListener("input", () => seek(Number(slider.value), { isPlaying: false }));
  speed.addEventListener("change", () => seek(stepNow(), { speed: Number(speed.value) }));
  function zoom(factor) {
    camera.zoom(factor, [camera.width / 2, camera.height / 2]);
    isRoadOld = true;
  }
  function ofSet(change) {
    if (isPair) return;
    const index = clamp(number + change, 0, entries.length - 1);
    if (index !== number) open(index);
  }
  var second = () => Math.max(1, Math.round(1 / (scene?.stepS ?? 1)));
  var ACTS = {
    " ": () => setPlaying(!head.isPlaying),
    k: () => setPlaying(!head.isPlaying),
    j: () => skip(-second()),
    l: () => skip(second()),
    ",": () => skip(-1),
    ".": () => skip(1),
    arrowleft: (event) => skip(event.shiftKey ? -10 : -1),
    arrowright: (event) => skip(event.shiftKey ? 10 : 1),
    f: () => setFollows(!follows),
    n: chooseNext,
    home: fit,
    v: toggleSlant,
    o: toggleOriginal,
    pageup: () => ofSet(-1),
    pagedown: () => ofSet(1),
    "+": () => zoom(ZOOM_STEP),
    "=": () => zoom(ZOOM_STEP),
    "-": () => zoom(1 / ZOOM_STEP),
    "?": toggleAbout,
    escape: () => about.hidden ? choose(null) : toggleAbout()
  };
  window.addEventListener("keydown", (event) => {
    const act = ACTS[event.key.toLowerCase()];
    if (!act || hasModifier(event) || isTyping(event) && event.target !== slider) return;
    if (event.key === " " && within(event, "button")) return;
    event.preventDefault();
    act(event);
  });
  var dark = matchMedia("(prefers-color-scheme: dark)");
  function setTheme() {
    look.theme = dark.matches ? 1 : 0;
    document.body.classList.toggle("pd-dark", dark.matches);
    isRoadOld = true;
  }
  dark.addEventListener("change", setTheme);
  build();
  setTheme();
  new ResizeObserver(resize).observe(stage);
  if (entries.length) open(0);
  requestAnimationFrame(frame);
})();
