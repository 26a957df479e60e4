/* Built by .ci/client.py from client/ (b639318741cf26d1); not to be edited. */
"use strict";
(() => {
  // src/bridge.ts
  var viewer = () => window.__viserMutable ?? {};
  var world = () => viewer().nodeRefFromName?.[""];
  var camera = () => viewer().camera ?? null;
  var canvas = () => viewer().canvas ?? null;
  function missing() {
    const found = viewer();
    const wanted = [
      [found.canvas, "the picture"],
      [found.camera && world(), "places on the picture"],
      [found.sendMessage, "answers of the page"],
      [controls(), "zoom to the pointer and panning"],
      [found.requestRender && found.messageQueue, "changes of the picture at once"],
      [window.__viserPointer?.cameraLockReasons, "drags of agents from above"],
      [window.__viserTestpoints?.devSettings?.set, "a picture without a cross"],
      [document.querySelector(TAB), "the panel"]
    ];
    return wanted.filter(([one]) => !one).map(([, what]) => what);
  }
  function sendValue(uuid, value) {
    viewer().sendMessage?.({ type: "GuiUpdateMessage", uuid, updates: { value } });
  }
  var connection = () => viewer().sendMessage;
  function toWorld(vector) {
    return world()?.localToWorld(vector) ?? vector;
  }
  function toScene(vector) {
    return world()?.worldToLocal(vector) ?? vector;
  }
  function project(point) {
    const [seen, element] = [camera(), canvas()];
    if (!seen || !world() || !element) return null;
    const vector = toWorld(seen.position.clone().set(point[0], point[1], point[2] ?? 0));
    if (vector.clone().applyMatrix4(seen.matrixWorldInverse).z >= 0) return null;
    vector.project(seen);
    return [(0.5 + vector.x / 2) * element.clientWidth, (0.5 - vector.y / 2) * element.clientHeight];
  }
  function ray(x, y) {
    const [seen, element] = [camera(), canvas()];
    if (!seen || !world() || !element) return null;
    const at = [2 * x / element.clientWidth - 1, 1 - 2 * y / element.clientHeight];
    const far = toScene(seen.position.clone().set(at[0], at[1], 0.5).unproject(seen));
    const eye = toScene(seen.position.clone());
    return [
      [eye.x, eye.y, eye.z],
      [far.x, far.y, far.z]
    ];
  }
  function ground(x, y) {
    const found = ray(x, y);
    if (!found) return null;
    const [eye, far] = found;
    const fall = eye[2] - far[2];
    if (fall <= 1e-9) return null;
    const reach = eye[2] / fall;
    return [eye[0] + reach * (far[0] - eye[0]), eye[1] + reach * (far[1] - eye[1])];
  }
  function controls() {
    const found = viewer().cameraControl;
    const names = ["getPosition", "getTarget", "setLookAt"];
    const isCapable = found && world() && names.every((name) => typeof found[name] === "function");
    return isCapable ? found : null;
  }
  function keepGestures(found, turns) {
    window.__viserTestpoints?.devSettings?.set?.({ enableOrbitCrosshair: false });
    const { ACTION } = found.constructor;
    const none = ACTION?.NONE ?? 0;
    found.azimuthRotateSpeed = found.polarRotateSpeed = turns ? 1 : 0;
    if (found.mouseButtons)
      Object.assign(found.mouseButtons, { left: turns ? ACTION?.ROTATE ?? 1 : none, right: none, middle: none });
  }
  var requestRender = () => viewer().requestRender?.();
  var hasMessages = () => Boolean(viewer().messageQueue?.length);
  function meshOf(name) {
    let found = "";
    viewer().nodeRefFromName?.[name]?.traverse?.((part) => {
      if (!found && part.isMesh) found = part.uuid;
    });
    return found;
  }
  function outline(prefix, width) {
    const element = canvas();
    if (!element) return;
    for (const [name, node] of Object.entries(viewer().nodeRefFromName ?? {})) {
      if (!name.startsWith(prefix)) continue;
      node?.traverse?.(({ material }) => {
        const uniforms = material?.uniforms;
        if (uniforms?.screenspace === void 0) return;
        uniforms.thickness.value = width;
        uniforms.size.value.set(element.width, element.height);
      });
    }
  }
  var dragsNode = () => Boolean(window.__viserPointer?.cameraLockReasons?.().includes("node-drag"));
  function showBox(isShown) {
    const box = viewer().canvas2d;
    if (box) box.style.visibility = isShown ? "" : "hidden";
  }
  var TAB = "[role=tab]";
  var SCROLLED = "[data-scrollarea-viewport]";
  var LIST = "input.mantine-Select-input";
  var SLIDER = "[class*=Slider-root]";
  var FIELD = ".mantine-NumberInput-root, .mantine-TextInput-root";
  var NUMBER = "input:is(.mantine-NumberInput-input, [type=number])";
  var FOLD = ".mantine-Paper-root[data-with-border] > .mantine-Paper-root";
  var DIALOG = ".mantine-Modal-content";
  var BESIDE_DIALOG = ".mantine-Modal-inner, .mantine-Modal-overlay";
  function hideNeedless() {
    const told = /* @__PURE__ */ new Set();
    for (const notice of [...document.querySelectorAll(".mantine-Notification-root")].reverse()) {
      const text = notice.textContent ?? "";
      const isNew = !told.has(text) && !text.endsWith("File uploaded successfully.");
      told.add(text);
      if (isNew || notice.style.display) continue;
      notice.style.display = "none";
      notice.querySelector(".mantine-Notification-closeButton")?.click();
    }
  }
  var ICON_NAMES = [
    [".mantine-Notification-closeButton", "Close the notice"],
    ["button:has(> * > .tabler-icon-list-search)", "All commands"],
    ["button:has(> * > .tabler-icon-adjustments)", "Settings of viser"]
  ];
  function nameControls() {
    for (const fold of document.querySelectorAll(FOLD)) {
      fold.tabIndex = 0;
      fold.role = "button";
      fold.ariaExpanded = String(!fold.nextElementSibling?.matches("[inert]"));
    }
    for (const [selector, name] of ICON_NAMES)
      for (const found of document.querySelectorAll(`${selector}:not([aria-label])`))
        found.setAttribute("aria-label", name);
    for (const label of document.querySelectorAll("p > label[for]")) {
      const row = label.closest("p")?.parentElement?.parentElement;
      const fields = [...row?.querySelectorAll("[role=slider], input:not([type=hidden])") ?? []];
      for (const [index, field] of fields.entries()) {
        if (field.getAttribute("aria-label") || field instanceof HTMLInputElement && field.labels?.length) continue;
        const isFirst = index === 0 || fields[0].matches("[role=slider]");
        field.setAttribute("aria-label", `${label.textContent}${isFirst ? "" : `, number ${index + 1}`}`);
      }
    }
  }
  function openTab(tab) {
    tab.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
    if (tab.getAttribute("aria-selected") !== "true") tab.click();
  }
  function isWhole(field) {
    if (field.type === "number") return !field.step;
    const known = field;
    let fiber = known[Object.keys(field).find((key) => key.startsWith("__reactFiber")) ?? ""];
    while (fiber && fiber.memoizedProps?.decimalScale === void 0) fiber = fiber.return;
    return fiber?.memoizedProps?.decimalScale === 0;
  }
  var CARET_MS = 100;
  function typeInto(field, text) {
    const property = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
    Object.assign(field, { focus: () => {
    } });
    setTimeout(() => Reflect.deleteProperty(field, "focus"), CARET_MS);
    for (const one of ["", text]) {
      property?.set?.call(field, one);
      field.dispatchEvent(new Event("input", { bubbles: true }));
    }
  }
  function letKeyGo(event) {
    if (/^(Key[WASDQE]|Arrow(Up|Down|Left|Right))$/.test(event.code))
      document.dispatchEvent(new KeyboardEvent("keyup", { code: event.code }));
  }
  function pressAlso(event, keys) {
    const { ctrlKey, metaKey } = event;
    event.preventDefault();
    const other = { ctrlKey, metaKey, bubbles: true, cancelable: true, ...keys };
    document.body.dispatchEvent(new KeyboardEvent("keydown", other));
  }
  var openCommands = (event) => pressAlso(event, { key: "k", code: "KeyK" });

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
    const picture2 = svg("svg", className, { viewBox: `0 0 ${grid} ${grid}`, "aria-hidden": "true" });
    picture2.append(svg("path", "", { d: path }));
    return picture2;
  }
  function button(className, text, act, attributes = {}) {
    const element = make("button", className, { type: "button", ...attributes }, text);
    element.addEventListener("click", act);
    return element;
  }
  var closeButton = (label, key, act) => button("pd-close", "×", act, { "aria-label": label, title: `Close (${key})` });
  var option = (value, text) => make("option", "", { value }, text);
  function fill(box, shown, parts) {
    const text = JSON.stringify(shown);
    if (box.dataset.shown === text) return;
    box.dataset.shown = text;
    const controls2 = () => [...box.querySelectorAll("button, select, input, [tabindex]")];
    const at = controls2().indexOf(document.activeElement);
    box.replaceChildren(...parts());
    controls2()[at]?.focus();
  }
  var within = (event, selector) => event.target instanceof Element ? event.target.closest(selector) : null;
  var isTyping = (event) => within(event, "input, textarea, select, [contenteditable]") !== null;
  var hasModifier = (event) => event.ctrlKey || event.metaKey || event.altKey;
  function recall(key) {
    try {
      return JSON.parse(window.localStorage.getItem(key) ?? "null");
    } catch {
      return null;
    }
  }
  function remember(key, value) {
    try {
      window.localStorage.setItem(key, JSON.stringify(value));
    } catch {
    }
  }
  var Signal = class {
    listeners = [];
    listen(listener) {
      this.listeners.push(listener);
    }
    tell(value) {
      for (const listener of this.listeners) listener(value);
    }
  };

  // src/frame.ts
  var TIP_GAP_PX = 14;
  var SLIM_PX = 380;
  var former = window.pdOverlay;
  former?.dispose();
  var definitions = /* @__PURE__ */ new Map();
  var mounted = /* @__PURE__ */ new Map();
  var waiting = /* @__PURE__ */ new Map();
  var CONTROLS = "button, a, label, input:not([type=range]), [role=button], [role=option], [role=tab], [role=listitem]";
  var pressed = null;
  var frameListeners = [];
  var cleanups = [];
  var number = 0;
  var answerUuid = null;
  var isAlive = true;
  var heard = Date.now();
  var root = make("div", "", { id: "pd-overlay" });
  var style = make("style");
  var guidanceIcons = {};
  var lostPicture = former?.picture ?? null;
  var heardAt = () => new Date(heard);
  var picture = () => overlay.picture;
  function keepPicture(element) {
    overlay.picture = element;
  }
  function define(name, mount2) {
    definitions.set(name, mount2);
  }
  function onView(listener) {
    frameListeners.push(listener);
  }
  function onDispose(cleanup) {
    cleanups.push(cleanup);
  }
  function markBody(name, isOn) {
    document.body.classList.toggle(name, isOn);
  }
  function listen(target, type, listener, options) {
    target.addEventListener(type, listener, options);
    cleanups.push(() => target.removeEventListener(type, listener, options));
  }
  function hearFirst(type, listener, options = {}) {
    listen(window, type, listener, { capture: true, ...options });
  }
  function pictureSize() {
    const element = canvas();
    return { width: element?.clientWidth ?? 0, height: element?.clientHeight ?? 0 };
  }
  var isOnPicture = (event) => event.target === canvas();
  function local(event) {
    const box = canvas()?.getBoundingClientRect();
    return [event.clientX - (box?.left ?? 0), event.clientY - (box?.top ?? 0)];
  }
  function take(event) {
    event.preventDefault();
    event.stopImmediatePropagation();
  }
  var isPanPress = () => document.body.classList.contains("pd-can-pan");
  var isModePress = (event) => event.button === 0 && isOnPicture(event) && !isPanPress();
  function followPress(held, release, giveUp) {
    hearFirst("pointerup", (event) => {
      const press = held();
      if (event.pointerId !== press?.id || event.button !== 0) return;
      take(event);
      release(event, press);
    });
    listen(window, "pointercancel", giveUp);
    listen(window, "blur", giveUp);
    hearFirst("keydown", (event) => {
      if (event.key !== "Escape" || !held()) return;
      take(event);
      giveUp();
    });
  }
  function modePress(mark, hear) {
    const press = {
      isOn: false,
      held: null,
      giveUp() {
        if (!press.held) return;
        press.held = null;
        hear.giveUp?.();
        hear.draw?.();
      },
      turn(isOn) {
        if (!isOn) press.giveUp();
        press.isOn = isOn;
        markBody(mark, isOn);
      }
    };
    hearFirst("pointerdown", (event) => {
      if (!press.isOn || !isModePress(event)) return;
      take(event);
      const held = hear.begin(local(event));
      if (held) press.held = { ...held, id: event.pointerId };
      hear.draw?.();
    });
    hearFirst("pointermove", (event) => {
      if (!press.isOn || press.held && event.pointerId !== press.held.id) return;
      if (press.held) hear.drag(press.held, local(event));
      else hear.hover?.(isOnPicture(event) ? local(event) : null, event);
      hear.draw?.();
    });
    followPress(
      () => press.held,
      (event, held) => {
        press.held = null;
        hear.release(held, event);
        hear.draw?.();
      },
      press.giveUp
    );
    onDispose(() => markBody(mark, false));
    return press;
  }
  function onDigit(count, choose) {
    hearFirst("keydown", (event) => {
      const digit = Number(event.key);
      if (hasModifier(event) || isTyping(event) || !Number.isInteger(digit) || digit < 1 || digit > count()) return;
      take(event);
      choose(digit);
    });
  }
  function linesWalked(event, numShown) {
    const pageful = Math.max(1, Math.floor(numShown) - 1);
    return {
      ArrowDown: 1,
      ArrowUp: -1,
      PageDown: pageful,
      PageUp: -pageful,
      Home: Number.NEGATIVE_INFINITY,
      End: Number.POSITIVE_INFINITY
    }[event.key];
  }
  var Tip = class {
    box = make("div", "pd-tip", { role: "tooltip" });
    constructor(parent) {
      this.hide();
      parent.append(this.box);
    }
    hide() {
      this.box.hidden = true;
    }
    tell(lines, [x, y]) {
      this.box.hidden = !lines.length;
      if (this.box.hidden) return;
      this.box.replaceChildren(...lines.map((line) => make("div", "", {}, line)));
      const [{ width, height }, { offsetWidth, offsetHeight }] = [pictureSize(), this.box];
      const below = y + TIP_GAP_PX;
      const fits = below + offsetHeight + 64 < height;
      this.box.style.left = `${Math.max(Math.min(x + TIP_GAP_PX, width - offsetWidth - 8), 8)}px`;
      this.box.style.top = `${fits ? below : y - offsetHeight - TIP_GAP_PX}px`;
    }
  };
  function everyFrame(draw) {
    if (!isAlive) return;
    draw();
    requestAnimationFrame(() => everyFrame(draw));
  }
  function paced(pauseMs, act) {
    let actedAt = Number.NEGATIVE_INFINITY;
    let late;
    function ask() {
      clearTimeout(late);
      const wait = actedAt + pauseMs - performance.now();
      if (wait > 0) late = setTimeout(ask, wait);
      else if (act()) actedAt = performance.now();
    }
    return { ask, stop: () => clearTimeout(late) };
  }
  function send(name, event) {
    if (answerUuid === null) return;
    number += 1;
    sendValue(answerUuid, JSON.stringify({ number, element: name, event }));
  }
  function mount(name, build) {
    const box = make("div", `pd-element pd-${name}`);
    root.append(box);
    const update = build({ box, send: (event) => send(name, event) });
    box.hidden = Boolean(update);
    mounted.set(name, (state) => {
      box.hidden = false;
      update?.(state);
    });
    if (!waiting.has(name)) return;
    mounted.get(name)?.(waiting.get(name));
    waiting.delete(name);
  }
  function fitToCanvas() {
    const box = canvas()?.getBoundingClientRect();
    if (!box) return;
    root.classList.toggle("pd-slim", box.width < SLIM_PX);
    markBody("pd-beside", box.right < innerWidth);
    document.body.style.setProperty("--pd-beside", `${innerWidth - box.right + 8}px`);
    for (const side of ["left", "top", "width", "height"]) {
      const text = `${box[side]}px`;
      if (root.style[side] !== text) root.style[side] = text;
    }
  }
  function letGo() {
    if (!pressed) return;
    pressed = null;
    for (const [name, state] of waiting) overlay.update(name, state);
  }
  var lastView = "";
  function lookAtView() {
    const [seen, element] = [camera(), canvas()];
    if (!seen || !element) return;
    const view = seen.matrixWorld.elements.map((value) => value.toPrecision(7)).join() + [seen.fov, element.clientWidth, element.clientHeight].join();
    if (view === lastView) return;
    lastView = view;
    fitToCanvas();
    for (const listener of frameListeners) listener(seen);
  }
  function start() {
    if (!isAlive) return;
    const element = canvas();
    if (!element) {
      setTimeout(start, 50);
      return;
    }
    fitToCanvas();
    const observer = new ResizeObserver(fitToCanvas);
    observer.observe(element);
    onDispose(() => observer.disconnect());
    listen(window, "resize", fitToCanvas);
    listen(root, "keyup", (event) => {
      if (event.key === " " && event.target instanceof HTMLButtonElement) event.preventDefault();
    });
    for (const [name, build] of definitions) mount(name, build);
    hearFirst("pointerdown", (event) => {
      const control = within(event, CONTROLS);
      pressed = control && { control, id: event.pointerId };
    });
    hearFirst("pointerup", () => setTimeout(letGo));
    for (const type of ["pointercancel", "blur"]) listen(window, type, letGo);
    hearFirst("pointermove", (event) => event.buttons === 0 && letGo(), { passive: true });
    requestAnimationFrame(() => everyFrame(lookAtView));
    send("page", { kind: "ready" });
  }
  var overlay = {
    project,
    ground,
    picture: null,
    start(uuid, icons, text) {
      answerUuid = uuid;
      guidanceIcons = icons;
      style.textContent = text;
      start();
    },
    update(name, state) {
      heard = Date.now();
      const update = mounted.get(name);
      const isKept = pressed && !pressed.control.hasPointerCapture(pressed.id);
      if (!update || isKept) waiting.set(name, state);
      else {
        waiting.delete(name);
        update(state);
      }
    },
    dispose() {
      isAlive = false;
      for (const cleanup of cleanups) cleanup();
      root.remove();
      style.remove();
    }
  };
  function install() {
    document.head.append(style);
    document.body.prepend(root);
    window.pdOverlay = overlay;
  }

  // src/elements/order.ts
  var ARMING = ["bar", "banner-bar", "menu-list", "guidance-tools"].map((name) => `.pd-${name} button`).join();
  var TYPES = ["pointerdown", "pointermove", "pointerup", "pointercancel", "click"];
  define("order", (api) => {
    let state = { keys: [], labels: [], answered: 0 };
    let asked = 0;
    let press = null;
    function ask() {
      asked += 1;
      setTimeout(() => api.send({ number: asked }));
    }
    const isAwaited = () => state.answered < asked;
    function goOn() {
      if (!press || isAwaited()) return;
      press.target ??= document.elementFromPoint(press.x, press.y) ?? canvas();
      for (const event of press.events.splice(0)) {
        const Same = event.constructor;
        press.target?.dispatchEvent(new Same(event.type, event));
      }
      if (press.isOver) press = null;
    }
    function hear(event) {
      if (!event.isTrusted) return;
      if (!press) {
        if (event.type !== "pointerdown" || event.button !== 0 || !isAwaited()) return;
        if (!isOnPicture(event) || isPanPress()) return;
        press = { x: event.clientX, y: event.clientY, events: [], isOver: false };
      }
      take(event);
      press.events.push(event);
      if (event.type === "pointerup" || event.type === "pointercancel")
        setTimeout(() => {
          if (press) press.isOver = true;
          goOn();
        });
      goOn();
    }
    for (const type of TYPES) hearFirst(type, (event) => hear(event));
    hearFirst("keydown", (event) => {
      if (event.repeat || hasModifier(event) || isTyping(event)) return;
      if (state.keys.includes(event.key.toUpperCase())) ask();
    });
    hearFirst("click", (event) => {
      const button2 = within(event, "button");
      if (button2?.matches(ARMING) || state.labels.includes(button2?.textContent.trim() ?? "")) ask();
    });
    return (next) => {
      state = next;
      goOn();
    };
  });

  // src/geometry.ts
  var distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  var clamp = (value, low, high) => Math.min(Math.max(value, low), high);
  var isSeen = (point) => point !== null;
  var between = (a, b, share) => [
    a[0] + share * (b[0] - a[0]),
    a[1] + share * (b[1] - a[1])
  ];
  var written = (point) => point.map((value) => value.toFixed(1)).join(" ");
  function along(pixels) {
    return pixels.map((point, index) => point && `${index && pixels[index - 1] ? "L" : "M"}${written(point)}`).join("");
  }
  function head(pixels, size = 9) {
    const seen = pixels.filter(isSeen);
    const tip = seen.at(-1);
    const before = tip && seen.findLast((point) => distance(tip, point) > 3);
    if (!before) return "";
    const angle = Math.atan2(tip[1] - before[1], tip[0] - before[0]);
    const side = (turn) => [
      tip[0] - size * Math.cos(angle + turn),
      tip[1] - size * Math.sin(angle + turn)
    ];
    return `M${written(side(0.5))}L${written(tip)}L${written(side(-0.5))}`;
  }
  function bow(from, to) {
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const length = Math.hypot(dx, dy);
    const rise = Math.min(0.22 * length, 60) / (length || 1);
    const sign = dx > 0 ? -1 : 1;
    const middle = between(from, to, 0.5);
    const knee = [middle[0] - sign * dy * rise, middle[1] + sign * dx * rise];
    return Array.from({ length: 21 }, (_, step) => {
      const t = step / 20;
      return between(between(from, knee, t), between(knee, to, t), t);
    });
  }
  function halfWay(pixels) {
    const steps = pixels.slice(1).map((point, index2) => distance(point, pixels[index2]));
    let rest = steps.reduce((sum, step) => sum + step, 0) / 2;
    const index = steps.findIndex((step) => {
      rest -= step;
      return rest <= 0;
    });
    if (index < 0) return pixels[0];
    return between(pixels[index], pixels[index + 1], 1 + rest / (steps[index] || 1));
  }
  function squareBetween(from, to) {
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    const half = Math.max(Math.abs(dx), Math.abs(dy)) / 2;
    return [from[0] + (dx < 0 ? -half : half), from[1] + (dy < 0 ? -half : half), half];
  }
  function outlineOf([x, y, half], parts) {
    const corners = [
      [x - half, y - half],
      [x + half, y - half],
      [x + half, y + half],
      [x - half, y + half]
    ];
    return corners.flatMap(
      (from, index) => Array.from({ length: parts }, (_, part) => between(from, corners[(index + 1) % 4], part / parts))
    );
  }
  function roundLength(most) {
    const power = 10 ** Math.floor(Math.log10(most));
    return (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1) * power;
  }
  function spotBeside([x, y], reach, { width, height }, picture2, placed) {
    const spots = [
      [1, -1],
      [-1, -1],
      [1, 1],
      [-1, 1]
    ].map(([side, rise]) => {
      const left = side > 0 ? x + reach : x - reach - width;
      const top = rise < 0 ? y - reach - height : y + reach;
      const outside = Math.max(0, -left) + Math.max(0, left + width - picture2.width) + Math.max(0, -top) + Math.max(0, top + height - picture2.height);
      const hits = placed.filter(
        (other) => left < other.left + other.width && other.left < left + width && top < other.top + other.height && other.top < top + height
      );
      const cost = outside + 1e3 * hits.length;
      return { spot: { left, top, width, height, side, rise }, cost };
    });
    return spots.reduce((best, one) => one.cost < best.cost ? one : best).spot;
  }

  // src/elements/aim.ts
  var STEP_PX = 6;
  var FAR = 10;
  var POINTER_ID = -36;
  var CLICKED = "body:is(.pd-guiding, .pd-crosshair)";
  var DRAGGED = "body:is(.pd-drawing-region, .pd-bending)";
  var MEASURED = ".pd-measure-layer:not(.pd-gone)";
  define("aim", (api) => {
    const cross = svg("svg", "pd-aim", { viewBox: "-12 -12 24 24", "aria-hidden": "true" });
    for (const name of ["pd-aim-halo", ""]) cross.append(svg("path", name, { d: "M-11 0H-3M3 0H11M0 -11V-3M0 3V11" }));
    api.box.append(cross);
    let at = null;
    let isHeld = false;
    const target = () => document.querySelector(MEASURED) ?? (document.querySelector(`${CLICKED}, ${DRAGGED}`) ? canvas() : null);
    function show(next) {
      at = next;
      if (!at) isHeld = false;
      cross.classList.toggle("pd-aims", at !== null);
      if (at) cross.style.transform = `translate(${at[0] - 12}px, ${at[1] - 12}px)`;
    }
    function tell(type) {
      const box = canvas()?.getBoundingClientRect();
      if (!at || !box) return;
      const place = { clientX: box.left + at[0], clientY: box.top + at[1], pointerId: POINTER_ID, detail: 1 };
      const held = { button: type === "pointermove" ? -1 : 0, buttons: Number(isHeld) };
      target()?.dispatchEvent(new PointerEvent(type, { ...place, ...held, bubbles: true, cancelable: true }));
    }
    function press() {
      const isDrag = document.querySelector(DRAGGED) !== null;
      if (!isHeld) {
        isHeld = true;
        tell("pointerdown");
        if (isDrag) return;
      }
      isHeld = false;
      tell("pointerup");
      if (document.querySelector(MEASURED)) tell("click");
    }
    hearFirst("keydown", (event) => {
      if (!target() || event.key === "Escape") show(null);
      if (!target() || hasModifier(event) || isTyping(event)) return;
      if (event.key === "Enter" && at) {
        take(event);
        press();
        return;
      }
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!by || within(event, "[role=slider], [role=tab], [role=option], [role=listbox], [role=dialog]")) return;
      take(event);
      const { width, height } = pictureSize();
      const [x, y] = at ?? [width / 2, height / 2];
      const far = STEP_PX * (event.shiftKey ? FAR : 1);
      show([clamp(x + by[0] * far, 0, width), clamp(y + by[1] * far, 0, height)]);
      tell("pointermove");
    });
    hearFirst("pointermove", (event) => {
      if (event.isTrusted && at && !isHeld) show(null);
    });
  });

  // src/agent_rows.ts
  var MARKS = [
    [1, "F", "focal agent", "pd-focal"],
    [2, "E", "ego", "pd-ego"],
    [64, "!", "has a problem", "pd-bad"],
    [256, "", "locked", "pd-locked"],
    [128, "~", "trajectory no longer fits", "pd-warn"],
    [4, "N", "new", "pd-new"],
    [8, "e", "edited", "pd-edited"],
    [16, "L", "comes later than t = 0", "pd-later"],
    [32, "G", "is gone by t = 0", "pd-later"]
  ];
  var NEW = 4;
  var MAIN = 3;
  function nextOrder(order, column) {
    if (order.column !== column) return { column, isDown: false };
    return order.isDown ? { column: -1, isDown: false } : { column, isDown: true };
  }
  function compare(a, b, column) {
    if (column === 0) return a[0].localeCompare(b[0], void 0, { numeric: true });
    if (column === 4) return b[4] - a[4];
    const [one, other] = [a, b].map((row) => Number(row[column] ?? Number.POSITIVE_INFINITY));
    return one === other ? 0 : one - other;
  }
  function arranged(rows, kinds, filter, order) {
    const words = filter.words.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const shown = [...rows.keys()].filter((place) => {
      const [id, kind, , , marks, isMoving] = rows[place];
      const main = MARKS.filter(([bit]) => marks & bit & MAIN).map(([, , word]) => word);
      const text = [kinds[kind][0], id, ...main].join(" ").toLowerCase();
      return words.every((word) => text.includes(word)) && (!filter.moving || isMoving) && (!filter.new || (marks & NEW) !== 0) && (filter.kind < 0 || filter.kind === kind);
    });
    if (order.column < 0) return shown;
    const sign = order.isDown ? -1 : 1;
    return shown.sort((a, b) => sign * compare(rows[a], rows[b], order.column) || a - b);
  }

  // src/shared.ts
  var agentUnderPointer = new Signal();
  var playheadMoved = new Signal();
  var clock = { step: () => 0 };
  var track = {
    box: null,
    stepS: 0.1,
    share: (_step) => 0,
    drawn: new Signal()
  };
  var taken = [];
  var padlock = () => icon("M3 7h10v7H3z M5 7V5a3 3 0 0 1 6 0v2", 16);
  function circle(point, radius) {
    const [x, y, z] = point;
    const at = project(point);
    const edges = [project([x, y + radius, z]), project([x + radius, y, z])];
    if (!at || !edges[0] || !edges[1]) return null;
    return { at, radius: Math.max(distance(edges[0], at), distance(edges[1], at)) };
  }
  function copyOf(source, into) {
    into.width = source.width;
    into.height = source.height;
    into.getContext("2d")?.drawImage(source, 0, 0);
  }

  // src/elements/agents.ts
  var ROW_PX = 24;
  var SPARE_ROWS = 4;
  var SHAPES = {
    vehicle: "box",
    bus: "long",
    pedestrian: "dot",
    cyclist: "peak",
    motorcyclist: "peak"
  };
  var COLUMNS = [
    ["Agent", "Sort by id", 0],
    ["m/s", "Sort by speed at t = 0", 2],
    ["m", "Sort by distance to the focal agent", 3],
    ["Marks", "Sort by marks", 4]
  ];
  var selected = /* @__PURE__ */ new Set();
  var followSelection = () => {
  };
  define("agents", (api) => {
    let state = { isOpen: false, number: 0, focal: "", ego: "", kinds: [], rows: [] };
    let shown = [];
    let underPointer = null;
    const drawer = make("div", "pd-solid pd-agents", { role: "region", "aria-label": "Agent list" });
    drawer.hidden = true;
    const search = make("input", "pd-search", {
      type: "search",
      placeholder: "Search by id, kind, focal, ego",
      "aria-label": "Search agents",
      spellcheck: "false",
      autocomplete: "off"
    });
    const head3 = make("div", "pd-agents-head");
    head3.append(
      search,
      closeButton("Close the agent list", "Ctrl+F", () => api.send({ kind: "close" }))
    );
    const filters = make("div", "pd-agents-filters");
    const filter = { words: "", moving: false, new: false, kind: -1 };
    for (const [key, text, title] of [
      ["moving", "Moving", "Only agents that move at t = 0"],
      ["new", "New", "Only agents that the recording does not have"]
    ]) {
      const toggle = () => {
        filter[key] = !filter[key];
        choice.setAttribute("aria-pressed", String(filter[key]));
        arrange();
      };
      const choice = button("", text, toggle, { "aria-pressed": "false", title });
      filters.append(choice);
    }
    const kindBox = make("select", "", { "aria-label": "Kind" });
    kindBox.addEventListener("change", () => {
      filter.kind = Number(kindBox.value);
      arrange();
    });
    filters.append(kindBox);
    let order = { column: -1, isDown: false };
    const columns = make("div", "pd-agents-columns");
    const headings = COLUMNS.map(([text, title, column]) => {
      const sort = () => {
        order = nextOrder(order, column);
        for (const [place, heading] of headings.entries()) {
          const [word, , other] = COLUMNS[place];
          const sign = order.isDown ? " ▾" : " ▴";
          heading.textContent = word;
          if (other === order.column) heading.append(make("span", "", { "aria-hidden": "true" }, sign));
        }
        arrange();
      };
      return button("", text, sort, { title, "aria-label": `${text}. ${title}` });
    });
    columns.append(...headings);
    const list = make("div", "pd-agents-list", {
      role: "listbox",
      "aria-label": "Agents",
      "aria-multiselectable": "true",
      tabindex: "0"
    });
    const space = make("div", "pd-agents-space");
    list.append(space);
    const count = make("div", "pd-agents-count", { role: "status" });
    const foot = make("div", "pd-agents-foot");
    const alike = () => {
      const kinds = new Set([...selected].map((row) => state.rows[row][1]));
      return [...state.rows.keys()].filter((row) => kinds.has(state.rows[row][1]));
    };
    for (const [text, title, wanted] of [
      ["All", "Select all agents of the list", () => [...shown]],
      ["None", "Select none", () => []],
      ["Invert", "Select the agents of the list that are not selected", () => shown.filter((row) => !selected.has(row))],
      ["Same kind", "Add all agents of the kinds that are selected", alike]
    ])
      foot.append(button("", text, () => choose(wanted()), { title }));
    const lock = () => api.send({ kind: "lock", number: state.number });
    foot.append(button("", "Lock", lock, { title: "Lock or unlock the selected agents (Shift+K)" }));
    drawer.append(head3, filters, columns, list, count, foot);
    api.box.append(drawer);
    function choose(rows) {
      api.send({ kind: "select", number: state.number, rows });
    }
    let anchor = null;
    let cursor = null;
    function pick(row, event) {
      const place = shown.indexOf(row);
      const from = anchor === null ? -1 : shown.indexOf(anchor);
      const isAdding = event.ctrlKey || event.metaKey;
      if (event.shiftKey && from >= 0) {
        const range = shown.slice(Math.min(from, place), Math.max(from, place) + 1);
        choose(isAdding ? [.../* @__PURE__ */ new Set([...selected, ...range])] : range);
      } else {
        anchor = row;
        const others = [...selected].filter((one) => one !== row);
        choose(!isAdding ? [row] : selected.has(row) ? others : [...others, row]);
      }
      cursor = row;
    }
    let pointed = null;
    function point(row) {
      if (row === pointed) return;
      pointed = row;
      api.send({ kind: "point", number: state.number, row });
    }
    const pool = /* @__PURE__ */ new Map();
    function rowElement(row) {
      const [id, kind, speed, distance2, marks] = state.rows[row];
      const [word, color] = state.kinds[kind];
      const element = make("div", "pd-agents-row", { role: "option" });
      const glyph = make("span", `pd-glyph pd-${SHAPES[word] ?? "thing"}`, {
        title: word,
        role: "img",
        "aria-label": word
      });
      glyph.style.background = marks & 1 ? state.focal : marks & 2 ? state.ego : color;
      const name = make("span", "pd-name", { title: `${word} ${id}` }, id);
      const numbers = [speed, distance2].map(
        (value) => make("span", "pd-number", {}, value === null ? "–" : value.toFixed(1))
      );
      const badges = make("span", "pd-badges");
      const own = MARKS.filter(([bit]) => marks & bit);
      for (const [, letter, title, style2] of own)
        badges.append(make("span", `pd-badge ${style2}`, { title, role: "img", "aria-label": title }, letter));
      element.append(glyph, name, ...numbers, badges);
      element.addEventListener("click", (event) => pick(row, event));
      element.addEventListener("pointerenter", () => point(row));
      pool.set(row, element);
      space.append(element);
      return element;
    }
    function redraw2() {
      if (drawer.hidden) return;
      const first = Math.max(0, Math.floor(list.scrollTop / ROW_PX) - SPARE_ROWS);
      const bottom = Math.ceil((list.scrollTop + list.clientHeight) / ROW_PX);
      const wanted = shown.slice(first, bottom + SPARE_ROWS);
      for (const [row, element] of pool)
        if (!wanted.includes(row)) {
          element.remove();
          pool.delete(row);
        }
      wanted.forEach((row, index) => {
        const element = pool.get(row) ?? rowElement(row);
        element.style.top = `${(first + index) * ROW_PX}px`;
        element.setAttribute("aria-selected", String(selected.has(row)));
        element.classList.toggle("pd-lit", state.rows[row][0] === underPointer);
        element.setAttribute("aria-posinset", String(first + index + 1));
        element.setAttribute("aria-setsize", String(shown.length));
      });
      const total = `${shown.length} of ${state.rows.length} listed`;
      count.textContent = `${total}, ${selected.size} selected`;
    }
    function arrange() {
      filter.words = search.value;
      shown = arranged(state.rows, state.kinds, filter, order);
      for (const element of pool.values()) element.remove();
      pool.clear();
      space.style.height = `${shown.length * ROW_PX}px`;
      redraw2();
    }
    function bringIntoSight(rows) {
      const places = [...rows].map((row) => shown.indexOf(row)).filter((place) => place >= 0);
      const top = list.scrollTop;
      const bottom = top + list.clientHeight - ROW_PX;
      const isSeen2 = (place) => place * ROW_PX >= top && place * ROW_PX <= bottom;
      if (!places.length || places.some(isSeen2)) return;
      list.scrollTop = places[0] * ROW_PX - list.clientHeight / 2;
    }
    followSelection = () => {
      redraw2();
      bringIntoSight(selected);
    };
    agentUnderPointer.listen((agent) => {
      underPointer = agent;
      if (drawer.hidden) return;
      const row = state.rows.findIndex(([id]) => id === agent);
      if (row >= 0) bringIntoSight([row]);
      redraw2();
    });
    list.addEventListener("scroll", redraw2);
    list.addEventListener("pointerleave", () => point(null));
    list.addEventListener("keydown", (event) => {
      const by = linesWalked(event, list.clientHeight / ROW_PX);
      if (!by || !shown.length) return;
      event.preventDefault();
      event.stopPropagation();
      const place = cursor === null ? -1 : shown.indexOf(cursor);
      const next = clamp(place + by, 0, shown.length - 1);
      pick(shown[next], event);
      const y = next * ROW_PX;
      list.scrollTop = clamp(list.scrollTop, y + ROW_PX - list.clientHeight, y);
    });
    search.addEventListener("input", arrange);
    search.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "ArrowDown") list.focus();
      if (event.key === "Enter" && shown.length) choose([...shown]);
      if (event.key !== "Escape") return;
      if (!search.value) api.send({ kind: "close" });
      search.value = "";
      arrange();
    });
    hearFirst("keydown", (event) => {
      if (!hasModifier(event) || event.shiftKey || event.altKey) return;
      if (event.key.toLowerCase() !== "f") return;
      event.preventDefault();
      if (isTyping(event)) api.send({ kind: event.target === search ? "close" : "open" });
    });
    return (next) => {
      const wasHidden = drawer.hidden;
      drawer.hidden = !next.isOpen;
      if (!next.isOpen) {
        const focus = document.activeElement;
        if (!wasHidden && drawer.contains(focus)) focus.blur();
        return;
      }
      state = next;
      const kinds = state.kinds.map(([name], kind) => option(kind, name));
      kindBox.replaceChildren(option(-1, "All kinds"), ...kinds);
      if (filter.kind >= state.kinds.length) filter.kind = -1;
      kindBox.value = String(filter.kind);
      selected = new Set([...selected].filter((row) => row < state.rows.length));
      arrange();
      if (!wasHidden) return;
      search.focus();
      bringIntoSight(selected);
    };
  });
  define("agent-selection", () => (state) => {
    selected = new Set(state.rows);
    followSelection();
  });

  // src/elements/banner.ts
  define("banner", (api) => {
    const bar = make("div", "pd-solid pd-banner-bar", { role: "status", "aria-live": "polite", "aria-label": "Mode" });
    const words = make("span", "pd-banner-text");
    bar.append(words);
    api.box.append(bar);
    bar.hidden = true;
    let owner = null;
    let names = "";
    return (state) => {
      owner = state.owner;
      bar.hidden = owner === null;
      words.textContent = state.text;
      if (names === state.buttons.join()) return;
      names = state.buttons.join();
      bar.replaceChildren(
        words,
        ...state.buttons.map((name) => button("", name, () => api.send({ owner, button: name })))
      );
    };
  });

  // src/elements/bending.ts
  var PULL_MS = 30;
  define("bending", (api) => {
    let numKinds = 0;
    const { ask, stop } = paced(PULL_MS, () => {
      if (press.held) api.send({ kind: "pull", point: press.held.point });
      return press.held !== null;
    });
    const press = modePress("pd-bending", {
      begin(at) {
        const point = ground(...at);
        if (point) api.send({ kind: "grab", point });
        return point && { point };
      },
      drag(held, at) {
        held.point = ground(...at) ?? held.point;
        ask();
      },
      release({ point }) {
        stop();
        api.send({ kind: "pull", point });
        api.send({ kind: "end" });
      },
      giveUp() {
        stop();
        api.send({ kind: "cancel" });
      }
    });
    onDigit(
      () => press.isOn ? numKinds : 0,
      (number2) => api.send({ kind: "kind", number: number2 })
    );
    return (state) => {
      numKinds = state.numKinds;
      press.turn(state.isActive);
    };
  });

  // src/elements/compare.ts
  define("compare", (api) => {
    const plate2 = make("div", "pd-solid pd-compare", { role: "status" });
    plate2.hidden = true;
    api.box.append(plate2);
    let isHeld = false;
    function hold(isDown) {
      if (isHeld === isDown) return;
      isHeld = isDown;
      api.send({ kind: isDown ? "hold" : "release" });
    }
    listen(document, "keydown", (event) => {
      if (event.code !== "KeyO" || event.repeat || isTyping(event)) return;
      if (!hasModifier(event) && !event.shiftKey) hold(true);
    });
    listen(document, "keyup", (event) => {
      if (event.code === "KeyO") hold(false);
    });
    listen(window, "blur", () => hold(false));
    return ({ text }) => {
      plate2.hidden = !text;
      plate2.textContent = text;
    };
  });

  // src/elements/compass.ts
  var LONGEST_PX = 120;
  var STEEP_ENOUGH = 0.2;
  define("compass", (api) => {
    const compass = button("pd-solid pd-compass", "", () => api.send({ kind: "turn" }));
    const dial = svg("svg", "", { viewBox: "0 0 40 40", "aria-hidden": "true" });
    dial.append(
      svg("path", "pd-north", { d: "M20 12.5 24.2 23 20 20.8 15.8 23z" }),
      svg("path", "pd-south", { d: "M20 35 24.2 24.6 20 22.6 15.8 24.6z" }),
      svg("text", "", { x: 20, y: 10.5, "text-anchor": "middle" }, "N")
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
      const isSeen2 = left && right && middle;
      compass.classList.toggle("pd-gone", !isSeen2);
      scale.classList.toggle("pd-gone", !isSeen2 || elevation(middle) < STEEP_ENOUGH);
      if (!isSeen2) return;
      const across = [right[0] - left[0], right[1] - left[1]];
      dial.style.transform = `rotate(${Math.atan2(across[1], across[0])}rad)`;
      const metresPerPixel = Math.hypot(...across) / 40;
      const length = roundLength(LONGEST_PX * metresPerPixel);
      bar.style.width = `${length / metresPerPixel}px`;
      const text = length >= 1e3 ? `${length / 1e3} km` : `${length} m`;
      words.textContent = isTop ? text : `${text} at the centre`;
      scale.setAttribute("aria-label", `Scale: ${words.textContent}`);
    }
    function elevation(middle) {
      const seen = camera();
      if (!seen) return 0;
      const eye = toScene(seen.position.clone());
      return eye.z / Math.hypot(eye.x - middle[0], eye.y - middle[1], eye.z);
    }
    onView(draw);
    return (state) => {
      isTop = state.isTop;
      const hint = !isTop ? "Compass: turn the view north" : state.isHeadingUp ? "Compass: focal agent's heading is up. Click for north up" : "Compass: north is up. Click for the focal agent's heading up";
      compass.setAttribute("aria-label", hint);
      compass.dataset.hint = hint;
      draw();
    };
  });

  // src/elements/connection.ts
  var TOLD_MS = 6e3;
  var ASKS_MS = 2e3;
  var WATCH_MS = 250;
  var FORBIDDEN = 403;
  define("connection", (api) => {
    const bar = make("div", "pd-solid pd-banner-bar pd-connection-bar", { role: "alert" });
    const words = make("span", "pd-banner-text");
    bar.append(words);
    bar.hidden = true;
    api.box.append(bar);
    const mine = connection();
    async function ask(saved) {
      const request = new AbortController();
      onDispose(() => request.abort());
      const answer = await fetch(location.href, { cache: "no-store", signal: request.signal }).catch(() => null);
      request.abort();
      if (answer?.status === FORBIDDEN)
        words.textContent = `The editor was started anew, with another address: open the one that it printed. ${saved}`;
      else
        setTimeout(() => {
          if (picture()) ask(saved);
        }, ASKS_MS);
    }
    function lose() {
      const source = canvas();
      const isUnsaved = root.querySelector(".pd-unsaved:not([hidden])");
      const saved = isUnsaved ? "The newest edits are not saved." : `Edits up to ${heardAt().toLocaleTimeString()} are saved.`;
      words.textContent = `Connection lost. ${saved} Reconnecting …`;
      bar.classList.remove("pd-good");
      bar.hidden = false;
      root.classList.add("pd-lost");
      const still = make("canvas", "pd-still");
      if (source) {
        copyOf(source, still);
        still.style.width = `${source.clientWidth}px`;
        still.style.height = `${source.clientHeight}px`;
      }
      api.box.prepend(still);
      keepPicture(still);
      ask(saved);
    }
    const watch = setInterval(() => {
      if (connection() !== mine && !picture()) lose();
    }, WATCH_MS);
    onDispose(() => clearInterval(watch));
    return ({ isNew }) => {
      if (!lostPicture) return;
      words.textContent = isNew ? "Connected to a server that was started anew. Your edits are under “Unfinished” (N)." : "Connected again. All edits are here.";
      bar.classList.add("pd-good");
      bar.hidden = false;
      setTimeout(() => {
        bar.hidden = bar.classList.contains("pd-good");
      }, TOLD_MS);
    };
  });

  // src/elements/curtain.ts
  var LONGEST_MS = 2e3;
  var REST = { ms: 120, frames: 3 };
  var NOTHING = { ms: 300, frames: 4 };
  define("curtain", (api) => {
    const still = make("canvas", "pd-still pd-gone");
    api.box.append(still);
    let number2 = 0;
    if (lostPicture) raise(lostPicture);
    function raise(source) {
      if (!still.classList.contains("pd-gone")) return;
      copyOf(source, still);
      still.classList.remove("pd-gone");
    }
    return ({ nodes }) => {
      number2 += 1;
      const source = number2 > 1 ? canvas() : lostPicture;
      if (!source || document.hidden) {
        still.classList.add("pd-gone");
        return;
      }
      const mine = number2;
      const start2 = performance.now();
      const former2 = nodes.map(meshOf);
      const changed = /* @__PURE__ */ new Set();
      let quietSince = start2;
      let quietFrames = 0;
      raise(source);
      function look() {
        if (mine !== number2) return;
        const now = performance.now();
        quietFrames += 1;
        nodes.forEach((name, index) => {
          const mesh = meshOf(name);
          if (changed.has(name) || !mesh || mesh === former2[index]) return;
          changed.add(name);
          quietSince = now;
          quietFrames = 0;
        });
        const patience = changed.size > 0 ? REST : NOTHING;
        const isQuiet = now - quietSince > patience.ms && quietFrames > patience.frames && !hasMessages();
        const isThere = changed.size === nodes.length || isQuiet;
        if (!isThere && now - start2 < LONGEST_MS) {
          requestAnimationFrame(look);
          return;
        }
        requestRender();
        requestAnimationFrame(
          () => requestAnimationFrame(() => {
            if (mine === number2) still.classList.add("pd-gone");
          })
        );
      }
      requestAnimationFrame(look);
    };
  });

  // src/elements/fan.ts
  var PAUSE_MS = 80;
  define("fan", (api) => {
    let isShown = false;
    let at = null;
    const { ask } = paced(PAUSE_MS, () => {
      if (isShown) api.send({ point: at && ground(...at) });
      return isShown;
    });
    hearFirst(
      "pointermove",
      (event) => {
        if (!isShown || event.buttons !== 0) return;
        at = isOnPicture(event) ? local(event) : null;
        ask();
      },
      { passive: true }
    );
    return (state) => {
      isShown = state.isShown;
    };
  });

  // src/guidance_shapes.ts
  function guidanceIcon(kind, size = 18) {
    const picture2 = icon(guidanceIcons[kind] ?? "", 20, "pd-guide-icon");
    picture2.setAttribute("width", String(size));
    picture2.setAttribute("height", String(size));
    return picture2;
  }
  function plate(kind, radius = 11) {
    const group = svg("g", "pd-guide-plate");
    const inner = svg("g", "", { transform: "translate(-8 -8) scale(0.8)" });
    inner.append(svg("path", "", { d: guidanceIcons[kind] ?? "" }));
    group.append(svg("circle", "", { r: radius }), inner);
    return group;
  }
  function flag(isOffer = false) {
    const group = svg("g", "pd-guide-flag");
    const cloth = "M0 -29H19L14 -22.5L19 -16H0z";
    const hit = isOffer ? "M-6 -34H23V-12H8V6H-8V-12H-6z" : "M-9 -34H24V8H-9z";
    group.append(
      svg("path", "pd-guide-hit", { d: hit }),
      svg("ellipse", "pd-guide-foot", { rx: 6, ry: 3.4 }),
      svg("path", "pd-guide-halo", { d: `M0 0V-29${cloth}` }),
      svg("path", "pd-guide-cloth", { d: cloth }),
      svg("path", "pd-guide-pole", { d: "M0 0V-30" })
    );
    return group;
  }
  function haloed(line) {
    return ["pd-guide-halo", "pd-guide-line"].map((name) => svg("path", name, { d: line }));
  }

  // src/elements/guidance_marks.ts
  var STILL_PX = 4;
  var SEND_MS = 50;
  var SETTLE_MS = 700;
  var HELD_BACK_PX = 16;
  var BADGE_PX = 23;
  var COVERED_PX = { left: -20, right: 37, top: -48, bottom: 2 };
  var DRAGGED2 = ["flag", "line", "dot"];
  var APART_PX = 44;
  var MISSED_PX = 5;
  var MODES = ["pd-crosshair", "pd-bending", "pd-drawing-region", "pd-guiding"];
  var keyOf = ({ index, node, isOffer }) => node == null ? String(index) : `${index} ${node} ${isOffer}`;
  define("guidance_marks", (api) => {
    const layer = svg("svg", "pd-guide-marks");
    api.box.append(layer);
    const tip = new Tip(api.box);
    let state = { marks: [], agents: [], refusal: "" };
    let press = null;
    let settling = null;
    let pointed = null;
    const isMode = () => MODES.some((name) => document.body.classList.contains(name));
    const cover = (left, top, right, bottom) => taken.push({ left, top, width: right - left, height: bottom - top });
    function isHeldBack(mark) {
      const hold = press ?? settling;
      if (!hold?.point || mark.shape === "badge") return false;
      if (hold.mark.shape === "dot")
        return keyOf(mark) === keyOf(hold.mark) || (mark.isOffer && hold.mark.isOffer) === true;
      return mark.index === hold.mark.index || !hold.known.has(mark.index);
    }
    function group(mark) {
      const classes = ["pd-guide", `pd-guide-${mark.kind}`];
      if (!mark.isOn) classes.push("pd-guide-off");
      if (mark.isFaint) classes.push("pd-guide-faint");
      if (mark.isChosen) classes.push("pd-guide-chosen");
      if (mark.isOffer) classes.push("pd-guide-offer");
      if (DRAGGED2.includes(mark.shape ?? "")) classes.push("pd-guide-drags");
      return svg("g", classes.join(" "), { "data-guide": keyOf(mark) });
    }
    function put(parent, picture2, [x, y]) {
      picture2.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
      parent.append(picture2);
    }
    function warn(parent, mark, [x, y]) {
      if (!mark.isBad) return;
      const badge = svg("g", "pd-guide-warning");
      const sign = svg("text", "", { "text-anchor": "middle", y: 4 }, "!");
      badge.append(svg("circle", "", { r: 7 }), sign);
      put(parent, badge, [x, y]);
    }
    function drawPlate(parent, mark, at) {
      put(parent, plate(mark.kind), at);
      warn(parent, mark, [at[0] + 10, at[1] - 10]);
    }
    function drawMissed(mark, parent, [x, y]) {
      const there = mark.achieved ? project(mark.achieved) : null;
      if (!there || mark.isFaint || distance(there, [x, y]) < MISSED_PX) return;
      parent.append(svg("path", "pd-guide-missed", { d: along([[x, y], there]) }));
      parent.append(svg("circle", "pd-guide-missed", { cx: there[0], cy: there[1], r: 4 }));
    }
    function drawDot(mark, parent) {
      const [from, to] = (mark.points ?? []).map(project);
      if (mark.isOffer && !(from && to && distance(from, to) > APART_PX)) return;
      const at = from && to ? [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2] : mark.point ? project(mark.point) : null;
      if (!at) return;
      drawMissed(mark, parent, at);
      const dot = svg("g");
      dot.append(
        svg("circle", "pd-guide-hit", { r: 11 }),
        svg("circle", "pd-guide-point", { r: mark.isOffer ? 3.5 : 6 })
      );
      if (mark.label) dot.append(svg("text", "pd-guide-label", { x: 11, y: 4 }, mark.label));
      put(parent, dot, at);
    }
    function isCovered(x, y) {
      const { left, right, top, bottom } = COVERED_PX;
      return left < x && x < right && top < y && y < bottom;
    }
    function drawFlag(mark, parent) {
      const foot = mark.point ? project(mark.point) : null;
      if (!foot) return;
      const from = mark.start ? project(mark.start) : null;
      if (mark.isOffer && from && isCovered(from[0] - foot[0], from[1] - foot[1])) return;
      if (from && !mark.isFaint && !mark.isOffer)
        parent.append(svg("path", "pd-guide-leader", { d: along([from, foot]) }));
      drawMissed(mark, parent, foot);
      put(parent, flag(mark.isOffer), foot);
      cover(foot[0] - 9, foot[1] - 34, foot[0] + 24, foot[1] + 8);
      warn(parent, mark, [foot[0] + 20, foot[1] - 31]);
    }
    function drawPath(mark, parent) {
      const pixels = (mark.points ?? []).map(project);
      const line = along(pixels);
      if (!line) return;
      parent.append(...haloed(line), ...haloed(head(pixels)));
      const seen = pixels.filter(isSeen);
      const hasDots = state.marks.some(({ shape, index }) => shape === "dot" && index === mark.index);
      if (hasDots) warn(parent, mark, [seen[seen.length - 1][0] + 14, seen[seen.length - 1][1] - 12]);
      else drawPlate(parent, mark, halfWay(seen));
    }
    function drawLine(mark, parent) {
      const pixels = (mark.points ?? []).map(project);
      if (!pixels.every(isSeen)) return;
      const line = along(pixels);
      parent.append(svg("path", "pd-guide-hit-line", { d: line }), ...haloed(line));
      const [xs, ys] = [0, 1].map((axis2) => pixels.map((point) => point[axis2]));
      cover(Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys));
      const [first, last] = pixels;
      const share = 15 / (distance(last, first) || 1);
      const beyond = (axis2) => first[axis2] - (last[axis2] - first[axis2]) * share;
      drawPlate(parent, mark, [beyond(0), beyond(1)]);
    }
    const bowOf = ({ start: start2, end: end2 }) => {
      const [from, to] = [start2 ? project(start2) : null, end2 ? project(end2) : null];
      return from && to && bow(from, to);
    };
    function drawArrow(mark, parent) {
      const points = bowOf(mark);
      if (!points) return;
      const ends = [points[0], points[points.length - 1]];
      const shown = points.filter((point) => ends.every((end2) => distance(point, end2) > HELD_BACK_PX));
      if (shown.length > 1) {
        const tip2 = svg("path", "pd-guide-line pd-guide-head", { d: head(shown) });
        parent.append(...haloed(along(shown)), tip2);
      }
      drawPlate(parent, mark, points[points.length >> 1]);
    }
    function drawArc(mark, parent) {
      const points = bowOf(mark);
      if (!points) return;
      parent.classList.add("pd-guide-arc");
      for (const name of ["pd-guide-hit-line", "pd-guide-line"]) parent.append(svg("path", name, { d: along(points) }));
      parent.append(svg("path", "pd-guide-line", { d: head(points, 7) }));
      if (!mark.points) return;
      const way = mark.points.map(project);
      parent.append(...haloed(along(way) + head(way)));
    }
    function drawBadges(badges, place) {
      const at = place && project(place);
      if (!at) return;
      badges.forEach((badge, index) => {
        const parent = group(badge);
        const x = at[0] + (index - (badges.length - 1) / 2) * BADGE_PX;
        put(parent, plate(badge.kind, 10), [x, at[1] + 30]);
        warn(parent, badge, [x + 9, at[1] + 22]);
        layer.append(parent);
      });
    }
    const drawings = { flag: drawFlag, dot: drawDot, path: drawPath, line: drawLine, arrow: drawArrow, arc: drawArc };
    function drawMark(mark) {
      if (mark.shape === "badge") drawBadges(mark.badges ?? [], mark.at ?? null);
      if (!mark.shape || mark.shape === "badge") return;
      const parent = group(mark);
      drawings[mark.shape](mark, parent);
      layer.append(parent);
    }
    function draw() {
      layer.replaceChildren();
      taken.length = 0;
      for (const mark2 of state.marks) if (!isHeldBack(mark2)) drawMark(mark2);
      const hold = press ?? settling;
      if (!hold?.point) return;
      const isBad = state.refusal !== "";
      const mark = { ...hold.mark, isOffer: false, isFaint: false, isChosen: true, isBad };
      if (mark.shape === "flag" || mark.shape === "dot")
        drawMark({ ...mark, point: hold.point, points: null, achieved: null });
      else drawMark(state.marks.find((one) => one.index === mark.index) ?? mark);
      if (isBad) layer.lastElementChild?.classList.add("pd-guide-refused");
    }
    function isOverAgent(at) {
      return state.agents.some(([x, y, z, radius]) => {
        const seen = circle([x, y, z], radius);
        return seen && distance(seen.at, at) <= Math.max(HELD_BACK_PX, seen.radius);
      });
    }
    function markOf(event) {
      const found = within(event, "[data-guide]");
      if (!found || !layer.contains(found)) return null;
      const all = state.marks.flatMap((mark) => mark.shape === "badge" ? mark.badges : [mark]);
      return all.find((mark) => keyOf(mark) === found.dataset.guide) ?? null;
    }
    const tellRefusal = (at) => tip.tell(state.refusal ? [state.refusal] : [], at);
    const send2 = (kind, { mark, point, isFree }) => api.send({ kind, index: mark.index, point, node: mark.node ?? null, isOffer: mark.isOffer === true, isFree });
    const { ask: sendDrag, stop: stopDrag } = paced(SEND_MS, () => {
      if (press?.point) send2("drag", press);
      return true;
    });
    function end(kind, held) {
      stopDrag();
      send2(kind, held);
      tip.hide();
      settling = kind === "drop" && held.point ? held : null;
      press = null;
      markBody("pd-guide-dragging", false);
      const mine = settling;
      setTimeout(() => {
        if (settling !== mine) return;
        settling = null;
        draw();
      }, SETTLE_MS);
      draw();
    }
    hearFirst("pointerdown", (event) => {
      tip.hide();
      if (event.button !== 0 || isMode() || isPanPress()) return;
      const mark = markOf(event);
      if (!mark) return;
      take(event);
      const at = local(event);
      const foot = mark.shape !== "line" && mark.point && project(mark.point) || at;
      press = {
        id: event.pointerId,
        mark,
        at,
        pointer: at,
        point: null,
        offset: [foot[0] - at[0], foot[1] - at[1]],
        known: new Set(state.marks.map((one) => one.index)),
        isFree: event.altKey
      };
      settling = null;
      send2("grab", press);
    });
    hearFirst("pointermove", (event) => {
      const at = local(event);
      if (press && event.pointerId === press.id) {
        take(event);
        const isStill = distance(at, press.at) <= STILL_PX;
        if (!press.point && (isStill || !DRAGGED2.includes(press.mark.shape ?? ""))) return;
        const point = ground(at[0] + press.offset[0], at[1] + press.offset[1]);
        if (!point) return;
        markBody("pd-guide-dragging", true);
        press.point = point;
        press.pointer = at;
        press.isFree = event.altKey;
        sendDrag();
        draw();
        tellRefusal(at);
        return;
      }
      if (event.buttons !== 0 || isMode()) {
        tip.hide();
        return;
      }
      const isOver = isOverAgent(at);
      layer.classList.toggle("pd-guide-over-agent", isOver);
      const found = markOf(event);
      const mark = isOver && found?.shape === "arc" ? null : found;
      tip.tell(mark?.lines ?? [], at);
      const index = mark?.shape === "arc" ? mark.index : null;
      if (index !== pointed) api.send({ kind: "point", index });
      pointed = index;
    });
    followPress(
      () => press,
      (_event, held) => end("drop", held),
      () => {
        if (press) end("cancel", { ...press, point: null });
      }
    );
    onView(draw);
    onDispose(() => markBody("pd-guide-dragging", false));
    return (next) => {
      const wasRefused = state.refusal;
      state = next;
      if (!press) settling = null;
      markBody(
        "pd-arcs",
        state.marks.some((mark) => mark.shape === "arc")
      );
      draw();
      if (press?.point && state.refusal !== wasRefused) tellRefusal(press.pointer);
    };
  });

  // src/elements/guidance_panel.ts
  var HOST = "[data-pd-host='guidance']";
  var NUM_FIRST_TOOLS = 3;
  var noted = ({ tone, text }) => make("div", `pd-guidance-note pd-tone-${tone}`, {}, text);
  function makeOf({ notes: _, isChosen, isOn, stop, inputs, ...made }) {
    const built = inputs.map(({ value, notes, ...input }) => input);
    return JSON.stringify({ ...made, inputs: built });
  }
  function setText(field, text) {
    if (field.value !== text || field.validity.badInput) field.value = text;
  }
  define("guidance_panel", (api) => {
    const box = make("div", "pd-hosted pd-guidance");
    const tools = make("div", "pd-guidance-tools", { role: "toolbar", "aria-label": "Add guidance" });
    const about = make("div", "pd-guidance-about");
    const ask = button("pd-guidance-ask", "", () => send2({ kind: "look" }));
    const possible = make("div", "pd-possible");
    possible.addEventListener("pointerleave", () => point(null));
    const list = make("ul", "pd-guidance-list", { "aria-label": "Guidance terms" });
    const foot = make("div", "pd-guidance-foot", { role: "status" });
    box.append(about, tools, ask, possible, foot, list);
    let state = null;
    let count = 0;
    let isUnfolded = false;
    const rows = /* @__PURE__ */ new Map();
    function attach() {
      const host = document.querySelector(HOST);
      if (host && box.parentElement !== host) host.replaceChildren(box);
    }
    const observer = new MutationObserver(attach);
    observer.observe(document.body, { subtree: true, childList: true });
    onDispose(() => {
      observer.disconnect();
      box.remove();
    });
    function send2(event) {
      count += 1;
      api.send({ ...event, version: state?.version ?? null, count });
      return count;
    }
    function point(number3) {
      const now = state?.encounters.items.findIndex((one) => one.isPointed) ?? -1;
      if (now !== (number3 ?? -1)) send2({ kind: "point", number: number3 });
    }
    listen(window, "click", (event) => {
      const tab = within(event, TAB);
      if (tab && tab.textContent.trim() !== "Agents" && state?.encounters.isOpen) send2({ kind: "leave" });
    });
    const isShort = ({ rows: rows2 }) => rows2.length > 0 && !isUnfolded;
    function showPossible(state2) {
      const { label, isEnabled, isOpen, about: told, items } = state2.encounters;
      ask.textContent = label;
      ask.disabled = !isEnabled;
      ask.setAttribute("aria-expanded", String(isOpen));
      ask.hidden = isShort(state2) && !isOpen;
      possible.hidden = !told;
      const made = JSON.stringify([told, items.map(({ agent, text }) => [agent, text])]);
      if (made !== possible.dataset.make) {
        possible.dataset.make = made;
        const lines = items.map((item, number3) => {
          const choose = () => send2({ kind: "make", number: number3 });
          const line = button(`pd-possible-line pd-guide-${item.kind}`, "", choose);
          line.append(guidanceIcon(item.kind, 15), make("b", "", {}, item.agent), make("span", "", {}, item.text));
          for (const name of ["pointerenter", "focus"]) line.addEventListener(name, () => point(number3));
          return line;
        });
        const head3 = make("div", "pd-guidance-about", { role: "status" }, told);
        possible.replaceChildren(head3, ...lines);
      }
      for (const [number3, item] of items.entries()) {
        const line = possible.children[number3 + 1];
        line.setAttribute("aria-pressed", String(item.isMade));
        line.classList.toggle("pd-possible-pointed", item.isPointed);
      }
    }
    function control(field, row, show, give) {
      let shown = row;
      let awaited = 0;
      field.addEventListener("input", () => {
        awaited = Number.POSITIVE_INFINITY;
      });
      field.addEventListener("change", () => {
        awaited = give();
      });
      field.addEventListener("blur", () => {
        if (Number.isFinite(awaited)) return;
        awaited = 0;
        show(shown);
      });
      show(row);
      return (next) => {
        shown = next;
        if (awaited <= (state?.answered ?? 0)) show(next);
      };
    }
    function toolOf({ kind, title, hint, isActive, isEnabled }) {
      const use = () => {
        isUnfolded = false;
        send2({ kind: "tool", tool: kind });
      };
      const made = button("pd-guidance-tool", "", use, {
        title: hint,
        "aria-label": title,
        "aria-pressed": String(isActive),
        "aria-disabled": String(!isEnabled)
      });
      made.append(guidanceIcon(kind), make("span", "", {}, title));
      return made;
    }
    function foldOf(more) {
      const fold = button("pd-guidance-more", isUnfolded ? "Fewer" : more, () => {
        isUnfolded = !isUnfolded;
        if (!state) return;
        showTools(state);
        showPossible(state);
        tools.querySelector(".pd-guidance-more")?.focus();
      });
      fold.setAttribute("aria-expanded", String(isUnfolded));
      return fold;
    }
    function showTools(state2) {
      const first = state2.tools.filter((tool) => tool.isEnabled).slice(0, isShort(state2) ? 0 : NUM_FIRST_TOOLS);
      const isFirst = (tool) => tool.isActive || first.includes(tool);
      const shown = state2.tools.filter((tool) => isUnfolded || isFirst(tool));
      const others = state2.tools.filter((tool) => !isFirst(tool)).slice(0, 3);
      const more = `${others.map((tool) => tool.title).join(", ")} ...`;
      fill(tools, [shown, isUnfolded, more], () => [...shown.map(toolOf), foldOf(more)]);
    }
    function number2(row, place) {
      const input = row.inputs[place];
      const field = make("input", "", {
        type: "number",
        min: String(input.least),
        max: String(input.most),
        step: String(input.step),
        "aria-label": `${input.label} of ${row.name}`,
        placeholder: input.empty
      });
      const show = (next) => setText(field, String(next.inputs[place].value ?? ""));
      const give = () => {
        const value = field.value === "" ? null : Number(field.value);
        return send2({ kind: "input", index: row.index, name: input.name, value });
      };
      return [field, control(field, row, show, give)];
    }
    function choice(row, place) {
      const input = row.inputs[place];
      const field = make("select", "", { "aria-label": `${input.label} of ${row.name}` });
      field.append(...input.options.map((one) => option(one, one)));
      const show = (next) => {
        const { value, notes } = next.inputs[place];
        for (const one of field.options) {
          const [few, sentence] = notes[one.value] ?? ["", ""];
          one.textContent = few ? `${one.value} – ${few}` : one.value;
          one.title = sentence;
        }
        field.value = String(value);
      };
      const give = () => send2({ kind: "input", index: row.index, name: input.name, value: field.value });
      return [field, control(field, row, show, give)];
    }
    function inputs(row, controls2) {
      const line = make("div", "pd-guidance-inputs");
      for (const [place, input] of row.inputs.entries()) {
        const label = make("label", "", {}, input.label);
        const [field, follow] = (input.options.length ? choice : number2)(row, place);
        controls2.push(follow);
        label.append(field);
        if (input.unit) label.append(make("span", "", {}, input.unit));
        line.append(label);
      }
      return line;
    }
    function strength(row, weights, controls2) {
      const label = make("label", "pd-guidance-strength", {}, "Strength");
      const slider = make("input", "", {
        type: "range",
        min: 0,
        max: weights.length - 1,
        step: 1,
        "aria-label": `Strength of ${row.name}`
      });
      const told = make("output");
      const tell = () => {
        told.textContent = `×${weights[Number(slider.value)]}`;
      };
      const weigh = (isEnd) => send2({ kind: "weight", index: row.index, stop: Number(slider.value), isEnd });
      slider.addEventListener("input", () => {
        tell();
        weigh(false);
      });
      const show = (next) => {
        slider.value = String(next.stop);
        tell();
      };
      controls2.push(control(slider, row, show, () => weigh(true)));
      label.append(slider, told);
      return label;
    }
    function build(row, weights) {
      const controls2 = [];
      const { index, name } = row;
      const item = make("li", "pd-guidance-row", { "aria-label": name });
      const head3 = make("div", "pd-guidance-head");
      const choose = button("pd-guidance-title", "", () => send2({ kind: "choose", index }), {
        title: `Select ${row.agents}`
      });
      const words = make("span", "pd-guidance-words");
      words.append(make("b", "", {}, row.title), make("span", "", {}, row.agents));
      choose.append(guidanceIcon(row.kind), words);
      const isOn = make("input", "", {
        type: "checkbox",
        role: "switch",
        title: "On or off",
        "aria-label": `${name} is on`
      });
      const show = (next) => {
        isOn.checked = next.isOn;
      };
      const give = () => send2({ kind: "switch", index, isOn: isOn.checked });
      controls2.push(control(isOn, row, show, give));
      const remove = button("pd-guidance-remove", "×", () => send2({ kind: "remove", index }), {
        title: "Delete",
        "aria-label": `Delete ${name}`
      });
      head3.append(choose, isOn, remove);
      const notes = make("div", "pd-guidance-notes");
      controls2.push((next) => notes.replaceChildren(...next.notes.map(noted)));
      item.append(head3, inputs(row, controls2));
      if (row.action) item.append(button("pd-guidance-take", row.action, () => send2({ kind: "act", index })));
      item.append(strength(row, weights, controls2), notes);
      return { make: makeOf(row), item, controls: controls2 };
    }
    function showRows(state2) {
      const former2 = new Map(rows);
      rows.clear();
      const items = state2.rows.map((row) => {
        const known = former2.get(row.index);
        const built = known?.make === makeOf(row) ? known : build(row, state2.weights);
        rows.set(row.index, built);
        for (const follow of built.controls) follow(row);
        built.item.classList.toggle("pd-guidance-off", !row.isOn);
        built.item.classList.toggle("pd-guidance-chosen", row.isChosen);
        return built.item;
      });
      const isSame = items.every((item, place) => list.children[place] === item);
      if (isSame && items.length === list.children.length) return;
      const focus = document.activeElement?.getAttribute("aria-label");
      list.replaceChildren(...items);
      if (!focus || list.contains(document.activeElement)) return;
      const all = [...list.querySelectorAll("[aria-label]")];
      all.find((one) => one.getAttribute("aria-label") === focus)?.focus();
    }
    function showFoot({ report, figures, action }) {
      foot.hidden = !report.length && !action;
      fill(foot, [report, figures, action], () => {
        const parts = report.map(noted);
        if (figures.length) {
          const table = make("table", "", { "aria-label": "Realism of the last run" });
          for (const [place, [name, guided, unguided, title]] of figures.entries()) {
            const line = make("tr", "", { title });
            for (const cell of [name, guided, unguided]) line.append(make(place ? "td" : "th", "", {}, cell));
            table.append(line);
          }
          parts.push(table);
        }
        if (action) parts.push(button("pd-guidance-take", action, () => send2({ kind: "take" })));
        return parts;
      });
    }
    return (next) => {
      state = next;
      attach();
      about.textContent = next.about;
      showTools(next);
      showPossible(next);
      showRows(next);
      showFoot(next);
      list.querySelector(".pd-guidance-chosen")?.scrollIntoView({ block: "nearest" });
    };
  });

  // src/elements/guiding.ts
  var ASK_MS = 60;
  var APART_PX2 = 2;
  var SAME_PX = 8;
  var MAX_POINTS = 1500;
  define("guiding", (api) => {
    const layer = svg("svg", "pd-guide-marks pd-guide-drawing");
    api.box.append(layer);
    const tip = new Tip(api.box);
    let state = null;
    let at = null;
    let line = [];
    let isClicked = false;
    const press = modePress("pd-guiding", {
      begin(pixel) {
        at = pixel;
        const point = ground(...pixel);
        return { at: pixel, points: state?.gesture === "draw" ? point ? [point] : [] : null };
      },
      drag(held, pixel) {
        at = pixel;
        const isFar = held.points && distance(pixel, held.at) >= APART_PX2;
        const point = isFar ? ground(...pixel) : null;
        if (!held.points || !point || held.points.length >= MAX_POINTS) return;
        held.points.push(point);
        held.at = pixel;
      },
      hover(pixel, event) {
        at = pixel;
        if (at && event.buttons === 0) ask();
      },
      release({ points }, event) {
        const pixel = local(event);
        const seen = points ? null : ray(...pixel);
        if (state && points) addToLine(points, state, event.altKey);
        else if (state && seen) api.send({ kind: "click", tool: state.kind, at: pixel, ray: seen });
      },
      draw
    });
    function stroke(parent, pixels, isArrow) {
      parent.append(...haloed(along(pixels)));
      if (isArrow) parent.append(svg("path", "pd-guide-line", { d: head(pixels) }));
    }
    function draw() {
      layer.replaceChildren();
      tip.hide();
      if (!state?.isActive) return;
      const { kind, gesture, ghost } = state;
      const refused = ghost.isBad ? "pd-guide-refused" : "";
      const parent = svg("g", `pd-guide pd-guide-${kind} pd-guide-chosen ${refused}`);
      layer.append(parent);
      if (gesture === "draw") {
        const next = line.length && at ? ground(...at) : null;
        const rest = press.held?.points ?? (next ? [next] : []);
        const points = [...line, ...rest].map(project);
        if (points.length > 1) stroke(parent, points, true);
        for (const [cx, cy] of line.map(project).filter(isSeen))
          parent.append(svg("circle", "pd-guide-point", { cx, cy, r: 4 }));
      } else if (gesture === "pick") {
        const from = project(state.start);
        const to = ghost.end ? project(ghost.end) : at;
        if (from && to) stroke(parent, bow(from, to), true);
      } else if (ghost.points) stroke(parent, ghost.points.map(project), kind !== "stop-at-line");
      else if (kind === "goal-point" && at) {
        const picture2 = flag();
        picture2.setAttribute("transform", `translate(${at[0]} ${at[1]})`);
        parent.append(picture2);
      }
      if (at && !press.held && ghost.text) tip.tell([ghost.text], at);
    }
    const { ask } = paced(ASK_MS, () => {
      if (!state?.isActive || press.held || !at || state.gesture === "draw") return false;
      const seen = ray(...at);
      if (seen) api.send({ kind: "point", tool: state.kind, at, ray: seen });
      return seen !== null;
    });
    function finish({ kind }) {
      const rounded = (value) => Math.round(value * 100) / 100;
      const points = line.map(([x, y]) => [rounded(x), rounded(y)]);
      line = [];
      api.send({ kind: "drawn", tool: kind, points, isClicked });
    }
    function isNear(one, other) {
      const [here, there] = [project(one), other ? project(other) : null];
      return here !== null && there !== null && distance(here, there) <= SAME_PX;
    }
    function addToLine(points, mode, isFree) {
      const isClick = points.length > 0 && points.every((point) => isNear(point, points[0]));
      if (isClick && line.length > 1 && isNear(points[0], line.at(-1))) {
        finish(mode);
        return;
      }
      const isWhole2 = !isClick && !line.length;
      isClicked = isClick && !isFree && (isClicked || !line.length);
      if (isClick && !line.length) line.push([mode.start[0], mode.start[1]]);
      line.push(...isClick ? [points[0]] : points);
      if (isWhole2) finish(mode);
    }
    hearFirst("keydown", (event) => {
      if (!state?.isActive || !line.length || press.held) return;
      if (event.key !== "Enter" && event.key !== "Backspace") return;
      take(event);
      if (event.key === "Enter") finish(state);
      else if (line.pop() && line.length === 1) line = [];
      draw();
    });
    onView(draw);
    return (next) => {
      if (!next.isActive || next.kind !== state?.kind) {
        press.giveUp();
        line = [];
      }
      state = next;
      press.turn(state.isActive);
      draw();
    };
  });

  // src/elements/hints.ts
  var KEPT = "pd-hints-done";
  var STEPS = [
    ["select", "Click a car", "to select it; Ctrl+drag selects several."],
    ["drag", "Drag it", "to move it; Shift+drag turns it."],
    ["bend", "Bend the road", "by hand (W), or in the tab Road."],
    ["regenerate", "Regenerate", "trajectories with the key R, or in the tab Generate."]
  ];
  var FILL = ["", "Fill the road", "with the button at the bottom."];
  define("hints", (api) => {
    const kept = recall(KEPT);
    const done = new Set(Array.isArray(kept) ? kept : []);
    const card = make("div", "pd-solid pd-hint", { role: "status", "aria-label": "Hint" });
    const count = make("span", "pd-hint-count");
    const what = make("b");
    const how = make("span");
    const label = "Close the hints";
    const close = () => finish(STEPS.map(([name]) => name));
    card.append(count, what, how, button("", "×", close, { "aria-label": label, title: label }));
    card.hidden = true;
    let isEmpty = false;
    api.box.append(card);
    function finish(names) {
      for (const name of names) done.add(name);
      remember(KEPT, [...done]);
      const index = STEPS.findIndex(([name]) => !done.has(name));
      card.hidden = index < 0;
      if (index < 0) return;
      count.textContent = isEmpty ? "" : `${index + 1} / ${STEPS.length}`;
      [, what.textContent, how.textContent] = isEmpty ? FILL : STEPS[index];
    }
    return (state) => {
      isEmpty = state.isEmpty;
      const followed = Object.entries(state.done).filter(([, isDone]) => isDone);
      finish(followed.map(([name]) => name));
    };
  });

  // src/elements/hover_outline.ts
  var WIDTH_PX = 2.5;
  var PAUSE_MS2 = 200;
  define("hover_outline", () => {
    let lookedAt = 0;
    function hideBox() {
      markBody("pd-holds-agent", dragsNode());
      showBox(!dragsNode());
    }
    for (const type of ["pointermove", "pointerup"])
      listen(window, type, () => requestAnimationFrame(hideBox), { passive: true });
    listen(
      window,
      "pointermove",
      () => {
        const now = performance.now();
        if (now - lookedAt < PAUSE_MS2) return;
        lookedAt = now;
        outline("/agents/", WIDTH_PX);
      },
      { passive: true }
    );
  });

  // src/elements/keys.ts
  define("keys", (api) => {
    const veil = make("div", "pd-veil");
    const sheet = make("div", "pd-solid pd-sheet", {
      role: "dialog",
      "aria-modal": "true",
      "aria-label": "Keys and mouse",
      tabindex: "-1"
    });
    const columns = make("div", "pd-sheet-columns");
    const close = button("pd-sheet-close", "×", () => show(false), { "aria-label": "Close" });
    sheet.append(close, columns);
    veil.append(sheet);
    veil.hidden = true;
    api.box.append(veil);
    let numOpened = 0;
    let before = null;
    function show(isOpen) {
      if (veil.hidden !== isOpen) return;
      veil.hidden = !isOpen;
      if (isOpen) {
        before = document.activeElement;
        sheet.focus();
      } else before?.focus?.();
    }
    listen(window, "keydown", (event) => {
      const isCommand = event.ctrlKey || event.metaKey;
      if (event.altKey || event.shiftKey || isTyping(event)) return;
      if (event.key === "Backspace" && !isCommand) pressAlso(event, { key: "Delete", code: "Delete" });
      if (event.key.toLowerCase() === "y" && isCommand) pressAlso(event, { key: "Z", code: "KeyZ", shiftKey: true });
    });
    hearFirst("keydown", (event) => {
      const asks = event.key === "F1" || event.key === "?" && !isTyping(event);
      if (asks && !hasModifier(event)) {
        event.preventDefault();
        show(Boolean(veil.hidden));
      } else if (veil.hidden) return;
      else if (event.key === "Escape") show(false);
      if (!event.ctrlKey && !event.metaKey) event.stopPropagation();
    });
    veil.addEventListener("pointerdown", (event) => {
      if (event.target === veil) show(false);
    });
    return (state) => {
      columns.replaceChildren(
        ...state.groups.map(({ title, rows }) => {
          const group = make("section");
          const list = make("dl");
          for (const { keys, does } of rows) {
            const row = make("div");
            row.append(make("dt", "", {}, keys), make("dd", "", {}, does));
            list.append(row);
          }
          group.append(make("h2", "", {}, title), list);
          return group;
        })
      );
      if (state.numOpened > numOpened) show(true);
      numOpened = state.numOpened;
    };
  });

  // src/elements/labels.ts
  var GAP_PX = 18;
  define("labels", (api) => {
    const leaders = svg("svg", "pd-leaders", { "aria-hidden": "true" });
    api.box.append(leaders);
    const plates = [];
    let labels = [];
    function newPlate() {
      const box = make("div", "pd-label", { role: "note" });
      const [text, note, line] = [make("div"), make("div", "pd-label-note"), svg("line")];
      box.append(text, note);
      api.box.append(box);
      leaders.append(line);
      return { box, text, note, line };
    }
    function place() {
      const placed = [...taken];
      while (plates.length < labels.length) plates.push(newPlate());
      plates.forEach(({ box, text, note, line }, index) => {
        const label = labels[index];
        const seen = label && circle(label.point, label.radius);
        box.style.display = line.style.display = seen ? "" : "none";
        if (!seen) return;
        if (text.textContent !== label.text) text.textContent = label.text;
        if (note.textContent !== label.note) note.textContent = label.note;
        const [reach, size] = [seen.radius * Math.SQRT1_2, { width: box.offsetWidth, height: box.offsetHeight }];
        const spot = spotBeside(seen.at, reach + GAP_PX * Math.SQRT1_2, size, pictureSize(), placed);
        placed.push(spot);
        box.style.transform = `translate(${Math.round(spot.left)}px, ${Math.round(spot.top)}px)`;
        const ends = {
          x1: seen.at[0] + spot.side * reach,
          y1: seen.at[1] + spot.rise * reach,
          x2: spot.side > 0 ? spot.left : spot.left + spot.width,
          y2: spot.rise < 0 ? spot.top + spot.height : spot.top
        };
        for (const [name, value] of Object.entries(ends)) line.setAttribute(name, String(value));
      });
    }
    onView(place);
    return (state) => {
      labels = state.labels;
      place();
    };
  });

  // src/elements/legend.ts
  var LOW_PX = 520;
  var KEPT2 = "pd-legend-folded";
  var ARCS = [
    ["Could threaten it", "var(--pd-bad)"],
    ["Could yield", "var(--pd-guide)"]
  ].map(([text, color]) => ({ text, glyph: "line", color, keeps: "", isArc: true }));
  define("legend", (api) => {
    const box = make("div", "pd-solid pd-legend-box");
    const list = make("ul", "pd-legend-list", { id: "pd-legend-list" });
    const chip = button("pd-legend-chip", "Legend", () => remember(KEPT2, fold(!list.hidden)), {
      "aria-controls": "pd-legend-list"
    });
    box.append(list, chip);
    api.box.append(box);
    function fold(isFolded) {
      list.hidden = isFolded;
      chip.setAttribute("aria-expanded", String(!isFolded));
      return isFolded;
    }
    fold((recall(KEPT2) ?? innerHeight < LOW_PX) === true);
    let wasLow = innerHeight < LOW_PX;
    listen(window, "resize", () => {
      const isLow = innerHeight < LOW_PX;
      if (isLow !== wasLow) fold(isLow || recall(KEPT2) === true);
      wasLow = isLow;
    });
    return ({ entries }) => {
      const lines = [...entries.map((entry) => ({ ...entry, isArc: false })), ...ARCS];
      list.replaceChildren(
        ...lines.map(({ text, glyph, color, keeps, isArc }) => {
          const item = make("li", isArc ? "pd-legend-arc" : "");
          const mark = make("span", `pd-legend-mark pd-legend-${glyph}`);
          mark.style.color = color;
          if (keeps) {
            mark.classList.add(`pd-lock-${keeps}`);
            mark.append(padlock());
          }
          item.append(mark, make("span", "", {}, text));
          return item;
        })
      );
    };
  });

  // src/elements/locks.ts
  var SIZE_PX = 18;
  var COMPACT_PX = 9;
  define("locks", (api) => {
    const plates = [];
    let locks = [];
    function plate2(index) {
      while (plates.length <= index) {
        const box = make("div", "pd-lock", { role: "img" });
        const text = make("span", "pd-lock-seconds");
        box.append(padlock(), text);
        api.box.append(box);
        plates.push({ box, text });
      }
      return plates[index];
    }
    function place() {
      const taken2 = [];
      locks.forEach(({ point, radius }, index) => {
        const { box } = plate2(index);
        const seen = circle(point, radius);
        box.style.display = seen ? "" : "none";
        if (!seen) return;
        box.classList.toggle("pd-compact", seen.radius < COMPACT_PX);
        const right = seen.at[0] - seen.radius * Math.SQRT1_2 + 3;
        const top = seen.at[1] + seen.radius * Math.SQRT1_2 - 3;
        const left = right - box.offsetWidth;
        const isFree = taken2.every(
          (other) => left >= other.right || right <= other.left || Math.abs(top - other.top) >= SIZE_PX
        );
        if (!isFree) {
          box.style.display = "none";
          return;
        }
        taken2.push({ left, right, top });
        box.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
      });
      for (const { box } of plates.slice(locks.length)) box.style.display = "none";
    }
    onView(place);
    return (state) => {
      locks = state.locks;
      locks.forEach(({ keeps, seconds, label }, index) => {
        const { box, text } = plate2(index);
        box.className = `pd-lock pd-lock-${keeps}`;
        box.setAttribute("aria-label", label);
        if (text.textContent !== seconds) text.textContent = seconds;
      });
      place();
    };
  });

  // src/elements/map_window.ts
  var LEAST_M = 10;
  define("mapWindow", (api) => {
    let square = [0, 0, 0];
    let press = null;
    const veil = make("div", "pd-veil pd-map-window");
    const card = make("div", "pd-solid", {
      role: "dialog",
      "aria-label": "Choose a part of the map",
      "aria-modal": "true"
    });
    const title = make("b");
    const named = { tabindex: 0, role: "img", "aria-label": "Map with the square; arrow keys move it" };
    const [map, road, rect] = [svg("svg", "", named), svg("path"), svg("rect")];
    map.append(road, rect);
    const size = make("input", "", { type: "number", min: LEAST_M, step: 10 });
    const label = make("label", "", {}, "Half side (m) ");
    const told = make("span");
    const cancel = () => api.send({ kind: "cancel" });
    const foot = make("div", "pd-map-window-foot");
    label.append(size);
    foot.append(
      label,
      told,
      button("", "Cancel", cancel),
      button("pd-map-window-open", "Open this part", () => api.send({ kind: "open", square }))
    );
    card.append(title, map, foot);
    veil.append(card);
    veil.hidden = true;
    api.box.append(veil);
    function draw() {
      const [x, y, half] = square;
      const box = { x: x - half, y: -y - half, width: 2 * half, height: 2 * half };
      for (const [name, value] of Object.entries(box)) rect.setAttribute(name, String(value));
      told.textContent = `${Math.round(2 * half)} × ${Math.round(2 * half)} m`;
      if (document.activeElement !== size) size.value = half.toFixed(0);
    }
    function metres2(event) {
      const at = new DOMPoint(event.clientX, event.clientY);
      const { x, y } = at.matrixTransform(map.getScreenCTM()?.inverse());
      return [x, -y];
    }
    map.addEventListener("pointerdown", (event) => {
      size.blur();
      press = metres2(event);
      map.setPointerCapture(event.pointerId);
      square = [...press, square[2]];
      draw();
    });
    map.addEventListener("pointermove", (event) => {
      const spanned = press && squareBetween(press, metres2(event));
      if (!spanned || spanned[2] < LEAST_M) return;
      square = spanned;
      draw();
    });
    map.addEventListener("pointerup", () => {
      press = null;
    });
    size.addEventListener("input", () => {
      square = [square[0], square[1], Math.max(Number(size.value), LEAST_M)];
      draw();
    });
    hearFirst("keydown", (event) => {
      if (veil.hidden) return;
      event.stopPropagation();
      if (event.key === "Escape") cancel();
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!by || event.target === size) return;
      event.preventDefault();
      const step = square[2] * (event.shiftKey ? 1 : 0.1);
      square = [square[0] + by[0] * step, square[1] + by[1] * step, square[2]];
      draw();
    });
    let before = null;
    return (state) => {
      if (!state.road && !veil.hidden) before?.focus();
      if (state.road && veil.hidden) before = document.activeElement;
      veil.hidden = !state.road;
      if (veil.hidden) return;
      square = [...state.square];
      title.textContent = state.title;
      road.setAttribute("d", state.road);
      map.setAttribute("viewBox", state.view);
      draw();
      map.focus();
    };
  });

  // src/elements/measure.ts
  var SAME_PX2 = 4;
  var LEAST_TOLD_M = 0.05;
  var metres = (value) => `${value.toFixed(value < 100 ? 1 : 0)} m`;
  define("measure", (api) => {
    const layer = make("div", "pd-picture pd-measure-layer pd-gone");
    const drawing = svg("svg");
    const labels = make("div");
    layer.append(drawing, labels);
    api.box.append(layer);
    let state = { isActive: false, start: null, speed: null, agent: "" };
    let points = [];
    let isComplete = false;
    let pointer = null;
    function line(from, to, name) {
      const ends = { x1: from[0], y1: from[1], x2: to[0], y2: to[1] };
      drawing.append(svg("line", "pd-measure-halo", ends), svg("line", name, ends));
    }
    function label(at, lines, name) {
      const element = make("div", `pd-measure-label ${name}`);
      for (const text of lines) element.append(make("div", "", {}, text));
      element.style.transform = `translate(${at[0]}px, ${at[1]}px)`;
      labels.append(element);
    }
    function draw() {
      drawing.replaceChildren();
      labels.replaceChildren();
      if (!state.isActive) return;
      const preview = !isComplete && points.length && pointer ? ground(...pointer) : null;
      const way = preview ? [...points, preview] : points;
      const pixels = way.map(project);
      let total = 0;
      for (let i = 1; i < way.length; i += 1) {
        const [from, to] = [pixels[i - 1], pixels[i]];
        const length = distance(way[i - 1], way[i]);
        total += length;
        if (!from || !to) continue;
        const isOpen = preview && i === way.length - 1;
        line(from, to, isOpen ? "pd-measure-open" : "pd-measure-line");
        const middle = [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2];
        if (way.length > 2 && length >= LEAST_TOLD_M) label(middle, [metres(length)], "pd-measure-part");
      }
      for (const [cx, cy] of pixels.slice(0, points.length).filter(isSeen))
        drawing.append(svg("circle", "", { cx, cy, r: 4 }));
      const end = pixels.at(-1);
      if (way.length < 2 || !end) return;
      const lines = [way.length > 2 ? `${metres(total)} in all` : metres(total)];
      const { speed, agent } = state;
      if (speed !== null) lines.push(`${(total / speed).toFixed(1)} s at ${speed.toFixed(1)} m/s (${agent})`);
      label(end, lines, "pd-measure-total");
    }
    layer.addEventListener("click", (event) => {
      if (event.button !== 0) return;
      if (event.detail === 2) {
        isComplete = points.length > 1;
        draw();
        return;
      }
      const at = local(event);
      const point = ground(...at);
      if (!point) return;
      if (isComplete) points = [];
      isComplete = false;
      const last = points.at(-1);
      const drawn = last && project(last);
      if (drawn && distance(at, drawn) < SAME_PX2) return;
      points.push(point);
      draw();
    });
    function follow(at) {
      pointer = at;
      draw();
    }
    layer.addEventListener("pointermove", (event) => follow(local(event)));
    layer.addEventListener("pointerleave", () => follow(null));
    hearFirst("keydown", (event) => {
      if (!state.isActive || hasModifier(event) || isTyping(event)) return;
      if (event.key === "Enter" && !(event.target instanceof HTMLButtonElement)) isComplete = points.length > 1;
      else if (event.key === "Backspace" || event.key === "Delete") {
        points.pop();
        isComplete = false;
      } else return;
      event.preventDefault();
      event.stopPropagation();
      draw();
    });
    onView(draw);
    return (next) => {
      if (next.isActive !== state.isActive) {
        points = next.start ? [next.start] : [];
        isComplete = false;
        pointer = null;
      }
      state = next;
      layer.classList.toggle("pd-gone", !state.isActive);
      draw();
    };
  });

  // src/elements/menu.ts
  var STILL_PX2 = 4;
  define("menu", (api) => {
    const list = make("div", "pd-solid pd-menu-list", { role: "menu" });
    list.hidden = true;
    api.box.append(list);
    let press = null;
    function close() {
      list.hidden = true;
    }
    function focusBy(steps) {
      const all = [...list.querySelectorAll("button:not(:disabled)")];
      const index = all.indexOf(document.activeElement);
      all[(index + steps + all.length) % all.length]?.focus();
    }
    const isInList = (event) => list.contains(event.target);
    hearFirst(
      "pointerdown",
      (event) => {
        if (!isInList(event)) close();
        const isRight = event.button === 2 && isOnPicture(event);
        press = isRight ? { id: event.pointerId, at: [event.clientX, event.clientY] } : null;
      },
      { passive: true }
    );
    const strays = (event, held) => distance([event.clientX, event.clientY], held.at) > STILL_PX2;
    hearFirst(
      "pointermove",
      (event) => {
        if (press && event.pointerId === press.id && strays(event, press)) press = null;
      },
      { passive: true }
    );
    hearFirst(
      "pointerup",
      (event) => {
        if (!press || event.pointerId !== press.id || event.button !== 2) return;
        const isClick = !strays(event, press);
        press = null;
        const at = local(event);
        const seen = isClick ? ray(...at) : null;
        if (seen) api.send({ kind: "open", at, ray: seen });
      },
      { passive: true }
    );
    hearFirst("contextmenu", (event) => {
      if (isOnPicture(event) || isInList(event)) event.preventDefault();
    });
    hearFirst("wheel", close, { passive: true });
    listen(window, "blur", close);
    onView(close);
    hearFirst("keydown", (event) => {
      if (list.hidden) return;
      if (event.key === "Escape") close();
      else if (event.key === "ArrowDown") focusBy(1);
      else if (event.key === "ArrowUp") focusBy(-1);
      else return;
      take(event);
    });
    return ({ number: number2, at, title, items }) => {
      close();
      if (!items.length) return;
      const lines = items.map((item, index) => {
        const choose = () => {
          close();
          api.send({ kind: "choose", index, menu: number2 });
        };
        const line = button("", "", choose, { role: "menuitem" });
        line.append(make("span", "", {}, item.label));
        if (item.key) line.append(make("span", "pd-menu-key", {}, item.key));
        line.disabled = !item.isEnabled;
        return line;
      });
      list.setAttribute("aria-label", title);
      list.replaceChildren(make("div", "pd-menu-title", {}, title), ...lines);
      list.hidden = false;
      const { width, height } = pictureSize();
      list.style.left = `${clamp(at[0] + 2, 8, width - list.offsetWidth - 8)}px`;
      list.style.top = `${clamp(at[1] + 2, 8, height - list.offsetHeight - 8)}px`;
    };
  });

  // src/elements/page.ts
  var BUILT_MS = 2e4;
  define("page", (api) => {
    listen(document, "keydown", (event) => {
      const isAsked = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "a";
      if (isAsked && !isTyping(event)) event.preventDefault();
    });
    hearFirst("keydown", (event) => {
      const isAsked = hasModifier(event) && !event.shiftKey && !event.altKey;
      if (!isAsked || event.key.toLowerCase() !== "k" || !event.isTrusted) return;
      if (!isTyping(event) || within(event, "[role=dialog]")) return;
      take(event);
      event.target.blur();
      openCommands(event);
    });
    hearFirst("keydown", (event) => {
      const dialog = event.key === "Tab" && root.querySelector(".pd-veil:not([hidden]) > [role=dialog]");
      if (!dialog) return;
      const all = [...dialog.querySelectorAll("button, input, select, [tabindex='0']")];
      const at = all.indexOf(document.activeElement) + (event.shiftKey ? -1 : 1);
      take(event);
      all.at(event.shiftKey && at < -1 ? -1 : at % all.length)?.focus();
    });
    listen(
      document,
      "pointerdown",
      (event) => {
        if (isOnPicture(event)) event.preventDefault = () => {
        };
      },
      { capture: true }
    );
    const lack = make("div", "pd-solid pd-banner-bar pd-lack-bar", { role: "alert" });
    lack.hidden = true;
    api.box.append(lack);
    let before = [];
    const watch = setInterval(() => {
      const names = missing();
      lack.hidden = !names.length || !before.length;
      lack.textContent = `This version of viser lacks what the editor needs for: ${names.join(", ")}.`;
      if (!names.length) clearInterval(watch);
      else if (before.length) {
        clearInterval(watch);
        api.send({ kind: "missing", names });
      }
      before = names;
    }, BUILT_MS);
    onDispose(() => clearInterval(watch));
    return ({ title, isDark }) => {
      document.title = title;
      root.classList.toggle("pd-dark", isDark);
      document.documentElement.classList.toggle("pd-dark-page", isDark);
    };
  });
  define("theme", (api) => {
    const KEPT3 = "pd-editor-dark";
    const browsers = window.matchMedia("(prefers-color-scheme: dark)");
    const tell = () => {
      const kept = recall(KEPT3);
      api.send({ isDark: typeof kept === "boolean" ? kept : browsers.matches });
    };
    listen(browsers, "change", tell);
    tell();
    return ({ isDark }) => remember(KEPT3, isDark);
  });

  // src/elements/panel.ts
  var PATIENCE_MS = 8e3;
  var RETRY_MS = 250;
  var NAMING_PAUSE_MS = 500;
  define("panel", (api) => {
    let wanted = null;
    let told = null;
    let startedAt = 0;
    let triedAt = Number.NEGATIVE_INFINITY;
    let isAwaited = false;
    const tabs = () => [...document.querySelectorAll(TAB)].filter((tab) => !root.contains(tab));
    const isOpen = (tab) => tab.getAttribute("aria-selected") === "true";
    const title = (tab) => tab.textContent.trim();
    function restore() {
      if (wanted === null) return;
      const now = performance.now();
      const tab = tabs().find((one) => title(one) === wanted);
      if (tab && isOpen(tab) || now - startedAt > PATIENCE_MS) wanted = null;
      else if (tab && now - triedAt > RETRY_MS) {
        triedAt = now;
        openTab(tab);
      }
    }
    function enter() {
      const open = tabs().find(isOpen);
      const all = [...scrolled()?.querySelectorAll("button, input, select, [tabindex='0']") ?? []];
      const first = all.find((one) => one.offsetParent && !one.matches(`${TAB}, ${FOLD}, :disabled`));
      (first ?? open)?.focus();
    }
    hearFirst("keydown", (event) => {
      if (event.key !== "F6" || hasModifier(event)) return;
      take(event);
      const focused = document.activeElement;
      const bar = root.querySelector(".pd-solid.pd-run");
      if (bar?.contains(focused)) focused.blur();
      else if (scrolled()?.contains(focused)) bar?.querySelector("button:enabled")?.focus();
      else enter();
    });
    function tell() {
      restore();
      if (wanted !== null) return;
      if (isAwaited) enter();
      isAwaited = false;
      const open = tabs().find(isOpen);
      const box = scrolled();
      if (!open || !box || title(open) === told) return;
      told = title(open);
      box.scrollTop = places.get(told) ?? 0;
      api.send({ kind: "tab", title: told });
    }
    const places = /* @__PURE__ */ new Map();
    const scrolled = () => tabs().find(isOpen)?.closest(SCROLLED);
    listen(
      document,
      "scroll",
      ({ target }) => {
        const box = scrolled();
        if (told !== null && box && target === box) places.set(told, box.scrollTop);
      },
      { capture: true }
    );
    let pressed2 = "";
    const note = (event) => {
      pressed2 = event instanceof KeyboardEvent ? event.key : "";
    };
    for (const type of ["keydown", "pointerdown"]) listen(document, type, note, { capture: true });
    const leaveShut = (event) => {
      if (pressed2 === "Tab" && within(event, LIST)) event.stopPropagation();
    };
    listen(document, "focusin", leaveShut, { capture: true });
    let isHeld = false;
    function release() {
      if (!isHeld) return;
      isHeld = false;
      api.send({ kind: "release" });
    }
    hearFirst("pointerdown", (event) => {
      release();
      if (event.button !== 0 || root.contains(event.target)) return;
      if (!within(event, SLIDER)) return;
      isHeld = true;
      api.send({ kind: "hold" });
    });
    hearFirst("pointerup", release);
    hearFirst("pointercancel", release);
    listen(window, "blur", release);
    listen(window, "keydown", (event) => {
      if (event.key !== "Enter" || event.isComposing || !(event.target instanceof HTMLInputElement)) return;
      const field = event.target;
      if (field.matches("[type=checkbox], [type=range]") || field.closest("[role=dialog]")) return;
      if (field.closest(`${FIELD}, .pd-guidance-inputs, .pd-run`)) field.blur();
    });
    const numbers = /* @__PURE__ */ new WeakMap();
    const held = /* @__PURE__ */ new WeakSet();
    const numberField = (event) => within(event, NUMBER);
    const numberIn = (text) => {
      const plain = text.trim().replace(",", ".").replace("−", "-");
      return plain ? Number(plain) : Number.NaN;
    };
    function settle(field) {
      const { value: text, validity } = field;
      const [number2, { first, last }] = [numberIn(text), numbers.get(field) ?? { first: "", last: "" }];
      const [isHeld2, isWhole2] = [held.delete(field), isWhole(field)];
      if (Number.isFinite(number2) && (Number.isInteger(number2) || !isWhole2)) {
        if (isHeld2) typeInto(field, String(number2));
      } else if (text || validity.badInput) {
        typeInto(field, first);
        const title2 = field.ariaLabel ?? field.labels?.[0]?.textContent ?? "";
        api.send({ kind: "refused", title: title2, typed: text, kept: first, isWhole: isWhole2 });
      } else if (text !== last && field.type !== "number") typeInto(field, last);
    }
    hearFirst("beforeinput", (event) => {
      const field = numberField(event);
      if (field?.type === "number" && event.data?.includes(",")) {
        event.preventDefault();
        document.execCommand("insertText", false, event.data.replaceAll(",", "."));
      }
      if (!field || held.has(field) || !Number.isFinite(numberIn(field.value))) return;
      if (field.value !== numbers.get(field)?.last) numbers.set(field, { first: field.value, last: field.value });
    });
    hearFirst("input", (event) => {
      const field = numberField(event);
      if (!field || !event.isTrusted) return;
      const text = field.value;
      held.delete(field);
      const isRead = field.type === "number" || (isWhole(field) ? /^-?\d*$/ : /^-?\d*\.?\d*$/).test(text);
      if (!isRead) {
        held.add(field);
        event.stopImmediatePropagation();
      } else if (Number.isFinite(numberIn(text))) numbers.set(field, { first: "", ...numbers.get(field), last: text });
    });
    hearFirst("keydown", (event) => {
      const field = numberField(event);
      if (field && held.has(field) && ["ArrowUp", "ArrowDown"].includes(event.key)) settle(field);
    });
    hearFirst("change", (event) => {
      const field = numberField(event);
      if (field) settle(field);
    });
    hearFirst("focusout", (event) => {
      const field = numberField(event);
      if (!field) return;
      if (field.type !== "number") settle(field);
      numbers.delete(field);
    });
    function leaveDialog() {
      const dialog = [...document.querySelectorAll(DIALOG)].at(-1);
      const last = [...dialog?.querySelectorAll("button") ?? []].at(-1);
      last?.click();
      return last !== void 0;
    }
    hearFirst("keydown", (event) => {
      if (event.key === "Escape" && leaveDialog()) event.stopImmediatePropagation();
    });
    hearFirst("click", ({ target }) => {
      if (target instanceof Element && target.matches(BESIDE_DIALOG)) leaveDialog();
    });
    hearFirst("keydown", (event) => {
      if (!event.target.matches?.(FOLD) || ![" ", "Enter"].includes(event.key)) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      event.target.click();
    });
    if (innerWidth < 760) api.send({ kind: "narrow" });
    let naming;
    const observer = new MutationObserver(() => {
      tell();
      hideNeedless();
      naming ??= setTimeout(() => {
        naming = void 0;
        nameControls();
      }, NAMING_PAUSE_MS);
    });
    onDispose(() => {
      observer.disconnect();
      clearTimeout(naming);
      markBody("pd-debug", false);
    });
    return (state) => {
      markBody("pd-debug", state.isDebug);
      wanted = state.tab;
      told = state.tab;
      isAwaited = state.takesFocus;
      startedAt = performance.now();
      observer.observe(document.body, {
        subtree: true,
        childList: true,
        attributes: true,
        attributeFilter: ["aria-selected", "inert"]
      });
      tell();
    };
  });

  // src/elements/placing.ts
  var TURN_PX = 8;
  var ASK_MS2 = 60;
  define("placing", (api) => {
    let mode = null;
    let at = null;
    const press = modePress("pd-crosshair", {
      begin(pixel) {
        at = pixel;
        const point = ground(...pixel);
        return point && { at: pixel, point, heading: null };
      },
      drag(held, pixel) {
        at = pixel;
        const isFar = distance(pixel, held.at) > TURN_PX;
        const point = isFar ? ground(...pixel) : null;
        if (point) held.heading = Math.atan2(point[1] - held.point[1], point[0] - held.point[0]);
        else if (!isFar) held.heading = null;
      },
      release({ point, heading }) {
        api.send({ kind: "place", point, headingRad: heading });
      },
      hover(pixel, event) {
        at = pixel;
        if (at && event.buttons === 0) ask();
      },
      draw
    });
    const drawing = svg("svg", "pd-placing-ghost", { "aria-hidden": "true" });
    const [base, edges, arrow] = ["base", "edges", "arrow"].map((name) => svg("path", `pd-placing-${name}`));
    drawing.append(base, edges, arrow);
    api.box.append(drawing);
    function draw() {
      const place = press.isOn ? press.held?.point ?? (at && ground(...at)) : null;
      const lines = mode && place && ghost(mode, place, press.held?.heading ?? mode.headingRad);
      drawing.style.display = lines ? "" : "none";
      if (!mode || !lines) return;
      [base, edges, arrow].forEach((path, index) => {
        path.setAttribute("d", lines[index]);
      });
      drawing.style.setProperty("--pd-placing", mode.color);
    }
    function ghost(state, place, heading) {
      const [length, width, height] = state.sizeM;
      const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
      const pixel = (forward, left2, up) => project([place[0] + forward * cos - left2 * sin, place[1] + forward * sin + left2 * cos, up]);
      const ring = (up) => [
        pixel(length / 2, width / 2, up),
        pixel(length / 2, -width / 2, up),
        pixel(-length / 2, -width / 2, up),
        pixel(-length / 2, width / 2, up)
      ];
      const reach = length / 2 + Math.max(2.2, length * 0.4);
      const [low, high] = [ring(0), ring(height)];
      const [tail, tip, left, right] = [
        pixel(length / 2 + 0.3, 0, 0),
        pixel(reach, 0, 0),
        pixel(reach - 0.9, 0.6, 0),
        pixel(reach - 0.9, -0.6, 0)
      ];
      if (![...low, ...high, tail, tip, left, right].every(isSeen)) return null;
      return [
        `${along(low)}Z`,
        `${along(high)}Z${low.map((point, index) => along([point, high[index]])).join("")}`,
        along([tail, tip]) + along([left, tip, right])
      ];
    }
    const { ask } = paced(ASK_MS2, () => {
      const point = press.isOn && !press.held && at ? ground(...at) : null;
      if (point) api.send({ kind: "point", point });
      return point !== null;
    });
    onDigit(
      () => press.isOn && mode ? mode.numKinds : 0,
      (number2) => api.send({ kind: "kind", number: number2 })
    );
    onView(draw);
    return (state) => {
      mode = state;
      press.turn(state.isActive);
      draw();
    };
  });

  // src/elements/region.ts
  var PARTS = 16;
  define("region", (api) => {
    let state = { isActive: false, leastM: 10, square: null };
    const press = modePress("pd-drawing-region", {
      begin(at) {
        const point = ground(...at);
        return point && { from: point, to: point };
      },
      drag(held, at) {
        held.to = ground(...at) ?? held.to;
      },
      release({ from, to }) {
        if (from[0] !== to[0] || from[1] !== to[1]) api.send({ kind: "drawn", start: from, end: to });
      },
      draw
    });
    const drawing = svg("svg", "pd-region-drawing", { "aria-hidden": "true" });
    const paths = ["area", "halo", "edge"].map((name) => svg("path", `pd-region-${name}`));
    drawing.append(...paths);
    const label = make("div", "pd-region-label pd-gone", { role: "group", "aria-label": "Region" });
    const text = make("span");
    const clear = "Clear the region";
    const close = button("pd-region-clear", "×", () => api.send({ kind: "clear" }), {
      title: clear,
      "aria-label": clear
    });
    label.append(text, close);
    api.box.append(drawing, label);
    function draw() {
      const { held } = press;
      const square = held ? squareBetween(held.from, held.to) : state.square;
      const ring = square && square[2] > 0 ? outlineOf(square, PARTS) : [];
      const seen = ring.map(project).filter(isSeen);
      const isShown = square !== null && seen.length > 2;
      drawing.style.display = isShown ? "" : "none";
      label.classList.toggle("pd-gone", !isShown);
      if (!isShown) return;
      for (const path of paths) path.setAttribute("d", `${along(seen)}Z`);
      const side = 2 * square[2];
      const isSmall = held !== null && side < state.leastM;
      drawing.classList.toggle("pd-region-small", isSmall);
      const width = side.toFixed(side < 100 ? 1 : 0);
      text.textContent = isSmall ? `${width} m: at least ${state.leastM} m` : `Region ${width} × ${width} m`;
      close.hidden = held !== null;
      label.classList.toggle("pd-solid", !held);
      const top = seen.reduce((one, other) => other[1] < one[1] ? other : one);
      const picture2 = pictureSize();
      const x = clamp(top[0], 90, picture2.width - 90).toFixed(1);
      const y = clamp(top[1], 96, picture2.height - 72).toFixed(1);
      label.style.transform = `translate(${x}px, ${y}px) translate(-50%, -130%)`;
    }
    onView(draw);
    return (next) => {
      state = next;
      press.turn(state.isActive);
      draw();
    };
  });

  // src/elements/pair.ts
  var COLORS = ["#3d7fe6", "#e06a1b", "#17a08f", "#d6337f"];
  var GROUND_COLOR = "rgba(139, 152, 165, 0.4)";
  define("pair", (api) => {
    const panel = make("section", "pd-solid pd-pair", { role: "dialog" });
    const sides = ["left", "right"].map((name, place) => {
      const box = make("div", "pd-pair-side");
      const title = make("select", "", { "aria-label": `On the ${name}`, title: "Another one here" });
      title.addEventListener("change", () => api.send({ kind: "choose", side: place, value: Number(title.value) }));
      const use = button("pd-pair-use", "", () => api.send({ kind: "use", value: state?.sides[place].index }));
      const head3 = make("div", "pd-pair-head");
      const canvas2 = make("canvas", "", { "aria-label": `Top view, ${name}` });
      head3.append(title, use);
      box.append(head3, canvas2);
      panel.append(box);
      return { title, use, canvas: canvas2 };
    });
    const close = closeButton("Close the comparison", "Esc", () => api.send({ kind: "close" }));
    panel.append(close);
    panel.hidden = true;
    api.box.append(panel);
    let state = null;
    let grounds = [];
    let view = { x: 0, y: 0, scale: 4 };
    function drawSide(canvas2, side, ground2, step) {
      const ratio = window.devicePixelRatio || 1;
      const [width, height] = [canvas2.clientWidth * ratio, canvas2.clientHeight * ratio];
      const pen = canvas2.getContext("2d");
      if (!width || !height || !pen) return;
      if (canvas2.width !== Math.round(width)) canvas2.width = Math.round(width);
      if (canvas2.height !== Math.round(height)) canvas2.height = Math.round(height);
      pen.setTransform(1, 0, 0, 1, 0, 0);
      pen.clearRect(0, 0, canvas2.width, canvas2.height);
      const scale = view.scale * ratio;
      const [left, top] = [canvas2.width / 2 - view.x * scale, canvas2.height / 2 + view.y * scale];
      pen.setTransform(scale, 0, 0, scale, left, top);
      pen.fillStyle = GROUND_COLOR;
      pen.fill(ground2, "evenodd");
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
        const mixed = (part) => path[3 * first + part] + (at - first) * (path[3 * next + part] - path[3 * first + part]);
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
      sides.forEach(({ canvas: canvas2 }, place) => {
        drawSide(canvas2, shown[place], grounds[place], step);
      });
    });
    for (const { canvas: canvas2 } of sides) {
      canvas2.addEventListener(
        "wheel",
        (event) => {
          event.preventDefault();
          const box = canvas2.getBoundingClientRect();
          const dx = event.clientX - box.left - box.width / 2;
          const dy = event.clientY - box.top - box.height / 2;
          const scale = clamp(view.scale * Math.exp(-event.deltaY / 500), 0.5, 40);
          const rest = 1 / view.scale - 1 / scale;
          view = { x: view.x + dx * rest, y: view.y - dy * rest, scale };
        },
        { passive: false }
      );
      canvas2.addEventListener("pointerdown", (event) => canvas2.setPointerCapture(event.pointerId));
      canvas2.addEventListener("pointermove", (event) => {
        if (!canvas2.hasPointerCapture(event.pointerId)) return;
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
      grounds = next.sides.map(({ ground: ground2 }) => new Path2D(ground2));
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

  // src/elements/run_bar.ts
  define("run", (api) => {
    const bar = make("div", "pd-solid pd-run", { role: "group", "aria-label": "Run" });
    const verbs = ["regenerate", "resample"].map(
      (kind) => button(`pd-run-${kind}`, "", () => api.send({ kind }))
    );
    const scope = make("select", "", { "aria-label": "Agents to regenerate", title: "Whom to regenerate" });
    scope.addEventListener("change", () => api.send({ kind: "scope", value: scope.value }));
    const numbers = ["samples", "seed"].map((kind) => {
      const name = { samples: "Samples", seed: "Seed" }[kind];
      const field = make("input", "", { type: "number", name: kind, "aria-label": name });
      field.addEventListener("change", () => {
        field.value = String(clamp(Math.round(field.valueAsNumber || 0), Number(field.min), Number(field.max)));
        api.send({ kind, value: Number(field.value) });
      });
      return { kind, field, label: make("label", "", {}, name) };
    });
    for (const { field, label } of numbers) label.append(field);
    const text = make("span", "pd-run-said", { role: "status", "aria-label": "Last run" });
    const use = button("pd-strong", "", () => api.send({ kind: "use" }));
    const cancel = button("pd-strong", "Cancel", () => api.send({ kind: "cancel" }));
    const progress = make("div", "pd-progress", {
      role: "progressbar",
      "aria-label": "Progress",
      "aria-valuemin": "0",
      "aria-valuemax": "100"
    });
    const end = make("div", "pd-run-end", { tabindex: 0 });
    end.append(text, use, cancel);
    bar.append(verbs[0], scope, verbs[1], ...numbers.map((one) => one.label), end, progress);
    api.box.append(bar);
    return (state) => {
      for (const [index, { label, target, isEnabled }] of state.verbs.entries()) {
        verbs[index].replaceChildren(make("span", "", {}, `${label} `), make("b", "", {}, target));
        verbs[index].title = `${label} ${target} (${index ? "settings in the tab Generate" : "R"})`;
        verbs[index].disabled = !isEnabled;
      }
      if (!scope.length) scope.append(...state.scopes.map((one) => option(one, one)));
      scope.value = state.scope;
      for (const { kind, field } of numbers) {
        [field.min, field.max] = state.limits[kind].map(String);
        if (document.activeElement !== field) field.value = String(state[kind]);
      }
      if (text.textContent !== state.text) text.textContent = state.text;
      end.toggleAttribute("data-hint", Boolean(state.text));
      if (state.text) end.dataset.hint = state.text;
      bar.dataset.tone = state.tone;
      use.hidden = !state.action;
      use.textContent = state.action;
      cancel.hidden = progress.hidden = state.fraction === null;
      const percent = 100 * (state.fraction ?? 0);
      progress.style.width = `${percent}%`;
      progress.setAttribute("aria-valuenow", String(Math.round(percent)));
    };
  });

  // src/elements/start_page.ts
  var STANDS = ' begin="indefinite"';
  var MOST_PICTURES = 400;
  var LINE_PAUSE_MS = 200;
  var KEEPS = "M10 2.6l2.3 4.7 5.2.7-3.8 3.6.9 5.1L10 14.3l-4.6 2.4.9-5.1L2.5 8l5.2-.7z";
  var REJECTS = "M5 5l10 10M15 5L5 15";
  var TICKS = "M4.5 10.5l3.5 3.5 7.5-8";
  var reduced = window.matchMedia("(prefers-reduced-motion: reduce)");
  var pictures = /* @__PURE__ */ new Map();
  var drawPicture = () => {
  };
  var asImage = (text) => `data:image/svg+xml,${encodeURIComponent(text)}`;
  define("startPage", (api) => {
    let state = null;
    let cursor = 0;
    let takesFocus = false;
    let asked = /* @__PURE__ */ new Set();
    let drawn = [];
    const page = make("section", "pd-start-page", { "aria-label": "All scenarios" });
    const sources = make("div", "pd-start-sources", { role: "tablist", "aria-label": "Sources" });
    const line = make("input", "pd-start-line", {
      type: "search",
      placeholder: "Find words, or what happens: cut-in and density > 20",
      "aria-label": "Find",
      maxlength: 500,
      spellcheck: "false"
    });
    const close = button("pd-start-close", "Back to the scene", () => tell({ kind: "close" }), { title: "Close (Esc)" });
    const head3 = make("header", "pd-start-head");
    head3.append(make("h1", "", {}, "Scenarios"), sources, line, close);
    const common = make("div", "pd-start-common", { role: "group", "aria-label": "What happens" });
    const facets = make("div", "pd-start-facets");
    const told = make("p", "pd-start-told", { role: "status" });
    const index = button("pd-start-index", "", () => tell({ kind: "index" }));
    const row = make("div", "pd-start-row");
    row.append(told, index, facets);
    const list = make("div", "pd-start-list", { role: "list", "aria-label": "Scenarios" });
    const pages = make("div", "pd-start-pages");
    const [before, after] = [-1, 1].map(
      (by) => button("", by < 0 ? "Previous" : "Next", () => turn(by), { title: by < 0 ? "Page Up" : "Page Down" })
    );
    const range = make("span");
    pages.append(before, range, after);
    const bulk = make("div", "pd-start-bulk", { role: "toolbar", "aria-label": "For several scenarios" });
    const tags = make("input", "pd-start-line", {
      type: "text",
      placeholder: "Tags, with commas",
      "aria-label": "Tags of these",
      maxlength: 500,
      spellcheck: "false"
    });
    const doBulk = (name) => tell({ kind: "bulk", name, value: tags.value });
    tags.addEventListener("keydown", (event) => {
      if (event.key === "Enter") doBulk("tag");
    });
    const keys = make(
      "p",
      "pd-start-keys",
      {},
      "Arrows walk · Enter opens · S saves to the library · X rejects · / finds"
    );
    const foot = make("footer", "pd-start-foot");
    foot.append(keys, pages);
    page.append(head3, common, row, list, bulk, foot);
    page.hidden = true;
    api.box.append(page);
    function tell(event) {
      api.send({ value: "", name: "", first: 0, keys: [], ...event });
    }
    const tiles = () => [...list.querySelectorAll(".pd-start-tile")];
    const first = () => state?.first ?? 0;
    const total = () => state?.total ?? 0;
    const size = () => state?.tiles.length ?? 0;
    const columns = () => {
      const tops = tiles().map((one) => one.parentElement?.offsetTop);
      const inFirst = tops.filter((top) => top === tops[0]).length;
      return Math.max(inFirst, 1);
    };
    const seen = new IntersectionObserver(
      (entries) => {
        const names = new Map(state?.tiles.map((one) => [one.key, one.picture]));
        const wanted = entries.filter((one) => one.isIntersecting).map((one) => one.target.dataset.key ?? "").filter((key) => !pictures.has(names.get(key) ?? ""));
        for (const key of wanted) asked.add(key);
        const open = [...asked].filter((key) => names.has(key) && !pictures.has(names.get(key) ?? ""));
        asked = new Set(open);
        if (wanted.length) tell({ kind: "draw", keys: open });
      },
      { root: list, rootMargin: "200px" }
    );
    onDispose(() => seen.disconnect());
    function show(tile, moves = false) {
      const text = pictures.get(tile.dataset.picture ?? "");
      const image = tile.querySelector("img");
      if (!image) return;
      tile.classList.toggle("pd-start-drawn", text !== void 0);
      if (text) image.src = asImage(moves && !reduced.matches ? text.replaceAll(STANDS, "") : text);
    }
    drawPicture = (name) => {
      for (const tile of tiles()) if (tile.dataset.picture === name) show(tile, tile.matches(":hover, :focus"));
    };
    function walk(to) {
      if (!total()) return;
      const target = clamp(to, 0, total() - 1);
      cursor = target;
      const tile = tiles()[target - first()];
      if (tile) focus(tile);
      else {
        takesFocus = true;
        tell({ kind: "page", first: target });
      }
    }
    function focus(tile) {
      for (const one of tiles()) one.tabIndex = one === tile ? 0 : -1;
      tile.focus({ preventScroll: true });
      tile.scrollIntoView({ block: "nearest" });
    }
    function turn(by) {
      const most = Math.max(total() - 1, 0);
      const target = by < 0 ? first() - 1 : first() + size();
      if (target >= 0 && target <= most) walk(target);
    }
    function tileOf(shown, at) {
      const box = make("div", "pd-start-box", {
        role: "listitem",
        "aria-setsize": total(),
        "aria-posinset": first() + at + 1
      });
      const tile = make("div", "pd-start-tile", {
        role: "button",
        tabindex: "-1",
        "aria-current": String(shown.isOpen),
        title: [shown.title, ...shown.lines].join("\n")
      });
      tile.dataset.key = shown.key;
      tile.dataset.picture = shown.picture;
      const frame = make("div", "pd-start-picture");
      frame.append(make("img", "", { alt: "", draggable: "false" }));
      if (shown.isOpen) frame.append(make("span", "pd-start-mark", {}, "In use"));
      const act = (kind, path, label, isOn = false) => {
        const made = button(`pd-start-act pd-start-${kind}`, "", () => tell({ kind, value: shown.key }), {
          tabindex: "-1",
          "aria-label": `${label}: ${shown.title}`,
          "aria-pressed": String(isOn),
          title: label
        });
        made.append(icon(path, 20));
        return made;
      };
      const acts = make("div", "pd-start-acts");
      if (shown.isTicked !== null) acts.append(act("tick", TICKS, "Tick (Space)", shown.isTicked ?? false));
      if (shown.canSave)
        acts.append(act("save", KEEPS, shown.isSaved ? "In the library" : "Save to the library (S)", shown.isSaved));
      if (shown.reject) acts.append(act("reject", REJECTS, `${shown.reject} (X)`));
      const words = make("div", "pd-start-words");
      words.append(
        make("strong", "", {}, shown.title),
        ...shown.lines.filter((text) => !text.startsWith(shown.title)).slice(0, 2).map((text) => make("div", "", {}, text))
      );
      if (shown.reject === "Discard for good") words.append(make("em", "", {}, "X again discards it for good"));
      tile.append(frame, words);
      box.append(tile, acts);
      tile.addEventListener("click", ({ ctrlKey, metaKey, shiftKey }) => {
        cursor = first() + at;
        const ticks2 = shown.isTicked !== null && (ctrlKey || metaKey || shiftKey);
        tell({ kind: ticks2 ? "tick" : "open", value: shown.key });
      });
      for (const type of ["pointerenter", "focusin"]) box.addEventListener(type, () => show(tile, true));
      for (const type of ["pointerleave", "focusout"]) box.addEventListener(type, () => show(tile));
      tile.addEventListener("focus", () => {
        cursor = first() + at;
      });
      return box;
    }
    function draw(next, isOther) {
      const hadFocus = list.contains(document.activeElement);
      const scrolled = list.scrollTop;
      seen.disconnect();
      list.replaceChildren(...next.tiles.map(tileOf));
      if (isOther) {
        list.scrollTop = 0;
        if (!takesFocus) cursor = next.first;
      } else list.scrollTop = scrolled;
      cursor = clamp(cursor, next.first, next.first + Math.max(next.tiles.length - 1, 0));
      for (const tile of tiles()) {
        show(tile);
        seen.observe(tile);
      }
      const current = tiles()[cursor - next.first];
      if (current) {
        current.tabIndex = 0;
        if (hadFocus || takesFocus) focus(current);
      }
      takesFocus = false;
    }
    function menus(next) {
      fill(
        sources,
        [next.sources, next.source],
        () => next.sources.map(({ value, text }) => {
          const made = button("", "", () => tell({ kind: "source", value: String(value) }), {
            role: "tab",
            "aria-selected": String(value === next.source)
          });
          const [name, count] = text.split(" ");
          made.append(`${name} `, make("span", "", {}, count));
          return made;
        })
      );
      const parts = next.line.split(/\s+and\s+/i);
      common.hidden = !next.common.length;
      fill(
        common,
        [next.common, parts],
        () => next.common.map(
          (value) => button("", value, () => tell({ kind: "common", value }), { "aria-pressed": String(parts.includes(value)) })
        )
      );
      fill(
        facets,
        next.facets,
        () => next.facets.map(({ name, label, value, choices }) => {
          const menu = make("select", "", { "aria-label": label });
          menu.append(...choices.map((one) => option(one.value, one.text)));
          menu.value = value;
          menu.addEventListener("change", () => tell({ kind: "facet", name, value: menu.value }));
          return menu;
        })
      );
    }
    function showBulk(next) {
      bulk.hidden = !next.bulk.length;
      if (JSON.stringify(next.bulk) === JSON.stringify(drawn)) return;
      drawn = next.bulk;
      const held = bulk.contains(document.activeElement) ? document.activeElement : null;
      const made = next.bulk.map(({ name, text, hint, isOn }) => {
        const one = button("", text, () => doBulk(name), { title: hint });
        one.dataset.name = name;
        one.disabled = !isOn;
        return one;
      });
      const [tick, ...others] = made;
      bulk.replaceChildren(...tick ? [tick] : [], tags, ...others);
      (held === tags ? tags : made.find((one) => one.dataset.name === held?.dataset.name))?.focus();
    }
    let late;
    line.addEventListener("input", () => {
      clearTimeout(late);
      late = setTimeout(() => tell({ kind: "line", value: line.value }), LINE_PAUSE_MS);
    });
    hearFirst("keydown", (event) => {
      if (page.hidden || hasModifier(event) || ["?", "F1", "Tab"].includes(event.key)) return;
      if (within(event, "[role=dialog], .mantine-Modal-content")) return;
      const isLine = event.target === line;
      const field = within(event, "input, textarea, select, [contenteditable]");
      if (event.key === "Escape" && (isLine || !field)) {
        take(event);
        tell({ kind: "close" });
      } else if (isLine) {
        if (event.key !== "ArrowDown" && event.key !== "Enter") return;
        take(event);
        walk(cursor);
      } else if (!field) hearKey(event);
    });
    function hearKey(event) {
      const isOurs = page.contains(event.target);
      const isButton = within(event, "button, [role=tab], a") !== null;
      if (isButton && ["Enter", " "].includes(event.key)) return;
      if (!isOurs && within(event, "[role=tab], [role=slider], [role=radio]")) return;
      const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
      const isThere = list.contains(document.activeElement);
      const by = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns(), ArrowDown: columns() }[key];
      const value = tiles()[cursor - first()]?.dataset.key;
      if (key === "n") {
        take(event);
        tell({ kind: "close" });
        return;
      }
      take(event);
      if (by !== void 0) walk(isThere ? cursor + by : cursor);
      else if (key === "Home") walk(0);
      else if (key === "End") walk(total() - 1);
      else if (key === "PageUp") turn(-1);
      else if (key === "PageDown") turn(1);
      else if (key === "/") line.focus();
      else if (value === void 0 || !isThere) return;
      else if (key === "Enter") tell({ kind: "open", value });
      else if (key === "s") tell({ kind: "save", value });
      else if (key === "x") tell({ kind: "reject", value });
      else if (key === " ") tell({ kind: "tick", value });
    }
    return (next) => {
      const former2 = state;
      state = next;
      const opens = next.isOpen && !former2?.isOpen;
      page.hidden = !next.isOpen;
      root.classList.toggle("pd-shows-start", next.isOpen);
      if (opens) asked.clear();
      if (!next.isOpen) return;
      menus(next);
      if (document.activeElement !== line) line.value = next.line;
      line.setAttribute("aria-invalid", String(next.isWrong));
      told.textContent = next.told;
      told.classList.toggle("pd-bad", next.isWrong);
      index.hidden = !next.index;
      index.textContent = next.index;
      index.classList.toggle("pd-start-first", !next.total && !next.index.startsWith("Cancel"));
      row.hidden = !(next.told || next.index || next.facets.length);
      showBulk(next);
      const isSame = former2?.isOpen && JSON.stringify(former2.tiles) === JSON.stringify(next.tiles);
      const isOther = former2?.source !== next.source || former2.line !== next.line || former2.first !== next.first;
      if (opens) takesFocus = true;
      if (!isSame || takesFocus) draw(next, isOther || opens);
      const isLong = next.total > next.tiles.length;
      pages.hidden = !isLong;
      range.textContent = `${next.first + 1} to ${next.first + next.tiles.length} of ${next.total}`;
      before.disabled = next.first === 0;
      after.disabled = next.first + next.tiles.length >= next.total;
    };
  });
  define("scene-picture", () => ({ name, picture: picture2 }) => {
    pictures.delete(name);
    pictures.set(name, picture2);
    const oldest = pictures.keys().next().value;
    if (pictures.size > MOST_PICTURES && oldest !== void 0) pictures.delete(oldest);
    drawPicture(name);
  });

  // src/elements/strip.ts
  var CARD_PX = 172;
  var TREE_PX = 12;
  var pictures2 = {};
  var redraw = {};
  var stripOf = (element, label) => (api) => {
    const strip = make("section", "pd-solid pd-samples", { "aria-label": label });
    const head3 = make("div", "pd-samples-head");
    const title = make("strong", "pd-samples-title");
    const chooser = (label2, kind) => {
      const select = make("select", "", { "aria-label": label2, title: label2 });
      select.addEventListener(
        "change",
        () => api.send({ kind, value: kind === "pick" ? Number(select.value) : select.value })
      );
      return select;
    };
    const ranking = chooser("Order of the samples", "rank");
    const pick = chooser("Samples shown", "pick");
    const hint = "Point to preview, click to use, C compares";
    const close = closeButton(`Close the ${label.toLowerCase()}`, "Esc", () => api.send({ kind: "close" }));
    const restore = button("pd-strip-restore", "", () => api.send({ kind: "restore" }));
    head3.append(title, ranking, pick, restore, make("span", "pd-samples-hint", {}, hint), close);
    const list = make("div", "pd-samples-list", {
      role: "listbox",
      "aria-label": `${label} to choose among`,
      "aria-orientation": "horizontal"
    });
    strip.append(head3, list);
    strip.hidden = true;
    api.box.append(strip);
    let state = null;
    let cursor = null;
    let pointed = null;
    let shownInUse = null;
    function point(index) {
      if (pointed === index) return;
      pointed = index;
      api.send(index === null ? { kind: "leave" } : { kind: "point", value: index });
    }
    const cards = () => [...list.querySelectorAll(".pd-sample")];
    const indexOf = (card) => Number(card.dataset.index);
    function moveTo(place) {
      const all = cards();
      if (!all.length) return;
      const card = all[clamp(place, 0, all.length - 1)];
      cursor = indexOf(card);
      for (const one of all) one.tabIndex = one === card ? 0 : -1;
      card.focus({ preventScroll: true });
      card.scrollIntoView({ block: "nearest", inline: "nearest" });
      point(cursor);
    }
    const drop = (card) => {
      if (state?.cards.find((one) => one.index === indexOf(card))?.canDrop)
        api.send({ kind: "drop", value: indexOf(card) });
    };
    function rename(card) {
      const words = card.querySelector(".pd-sample-words");
      if (!words || state?.cards.find((one) => one.index === indexOf(card))?.forkOf === null) return;
      const field = make("input", "pd-sample-field", { "aria-label": "Name of the branch", maxlength: 100 });
      field.value = words.textContent;
      words.replaceWith(field);
      field.select();
      field.addEventListener("click", (event) => event.stopPropagation());
      field.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== "Escape") return;
        take(event);
        if (event.key === "Enter") api.send({ kind: "rename", value: indexOf(card), text: field.value });
        leave();
        moveTo(cards().findIndex((one) => indexOf(one) === indexOf(card)));
      });
      field.addEventListener("blur", leave);
      function leave() {
        field.removeEventListener("blur", leave);
        field.remove();
        draw();
      }
    }
    strip.addEventListener("pointerleave", () => point(null));
    strip.addEventListener("keydown", (event) => {
      const place = cards().findIndex((one) => indexOf(one) === cursor);
      const target = { ArrowLeft: place - 1, ArrowRight: place + 1, Home: 0, End: Number.POSITIVE_INFINITY }[event.key];
      const at = event.target;
      const card = at.closest(".pd-sample");
      const isBranch = element === "branches" && card !== null;
      if (at.matches("select, input")) return;
      if (event.key === "Escape") api.send({ kind: "close" });
      else if (isBranch && event.key === "F2") rename(card);
      else if (isBranch && event.key === "Delete") drop(card);
      else if (target !== void 0) moveTo(target);
      else if (event.key === "Enter" && at.classList.contains("pd-sample"))
        api.send({ kind: "adopt", value: indexOf(at) });
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
    strip.addEventListener("focusout", (event) => {
      if (!strip.contains(event.relatedTarget) && !strip.matches(":hover")) point(null);
    });
    function offer(select, choices, value) {
      select.hidden = !choices.length;
      fill(select, choices, () => choices.map((one) => option(one.value, one.text)));
      select.value = String(value);
    }
    function cardOf({ index, name: words, mark, isAdopted, lines, hint: hint2, canDrop, isKept, forkOf }) {
      const box = make("div", "pd-sample-box");
      const card = make("div", "pd-sample", {
        role: "option",
        tabindex: "-1",
        "aria-selected": String(isAdopted),
        "aria-label": words,
        title: hint2
      });
      card.dataset.index = String(index);
      const picture2 = make("img", "", { alt: "", draggable: "false" });
      const source = pictures2[element]?.[index];
      if (source) picture2.src = source;
      const name = make("div", "pd-sample-name");
      name.append(make("span", "pd-sample-words", {}, words), make("span", "pd-sample-rank", {}, mark));
      card.append(
        picture2,
        name,
        ...lines.map(({ text, tone }) => make("div", tone ? `pd-sample-line pd-${tone}` : "pd-sample-line", {}, text))
      );
      card.addEventListener("pointerenter", () => point(index));
      card.addEventListener("click", () => {
        cursor = index;
        api.send({ kind: "adopt", value: index });
      });
      const tell = (kind) => () => api.send({ kind, value: index });
      const more = (kind, sign, label2, title2, act = tell(kind)) => button(`pd-sample-act pd-sample-${kind}`, sign, act, { tabindex: "-1", "aria-label": label2, title: title2 });
      box.append(
        card,
        isKept ? more("keep", "★", `In the library: ${words}`, "In the library") : more("keep", "☆", `Use and save to the library: ${words}`, "Use it and save it to the library")
      );
      box.classList.toggle("pd-is-kept", isKept);
      if (!isAdopted)
        box.append(more("pair", "◫", `Compare with the one in use: ${words}`, "Side by side with the one in use"));
      if (element === "branches" && forkOf !== null) {
        box.append(more("rename", "✎", `Rename: ${words}`, "Use it and give it a name (F2)", () => rename(card)));
        box.append(more("carry", "⇶", `On other scenes: ${words}`, "Use it and choose other scenes for its edits"));
      }
      if (canDrop) box.append(more("drop", "✕", `Delete: ${words}`, "Delete it from this strip (Del)"));
      return box;
    }
    function tree(shown) {
      const places = new Map(shown.map(({ index }, place) => [index, place]));
      const levels = /* @__PURE__ */ new Map();
      const center = (index) => ((places.get(index) ?? 0) + 0.5) * CARD_PX;
      const lines = shown.map(({ index, forkOf }) => {
        const level = forkOf === null ? 0 : (levels.get(forkOf) ?? 0) + 1;
        levels.set(index, level);
        if (forkOf === null) return "";
        const y = Math.min(level * 4 - 2, TREE_PX - 2);
        return `M${center(forkOf)} ${TREE_PX}V${y}H${center(index)}V${TREE_PX}`;
      });
      const width = shown.length * CARD_PX;
      const picture2 = svg("svg", "pd-strip-tree", { width: `${width}`, height: `${TREE_PX}`, "aria-hidden": "true" });
      picture2.append(svg("path", "", { d: lines.join("") }));
      return picture2;
    }
    const draw = () => {
      strip.hidden = !state?.isOpen;
      root.classList.toggle("pd-shows-samples", root.querySelector(".pd-samples.pd-solid:not([hidden])") !== null);
      if (!state?.isOpen) {
        pointed = cursor = shownInUse = null;
        return;
      }
      if (list.querySelector(".pd-sample-field")) return;
      const hadFocus = list.contains(document.activeElement);
      title.textContent = state.title;
      restore.hidden = !state.numDropped;
      restore.textContent = `Put back ${state.numDropped} deleted`;
      offer(ranking, state.rankings, state.ranking);
      offer(pick, state.picks, state.pick);
      list.replaceChildren(...state.cards.map(cardOf));
      if (state.cards.some(({ forkOf }) => forkOf !== null)) list.prepend(tree(state.cards));
      const all = cards();
      const current = all.find((one) => indexOf(one) === cursor) ?? all.find((one) => one.getAttribute("aria-selected") === "true") ?? all[0];
      if (!current) return;
      current.tabIndex = 0;
      const inUse = state.cards.find((one) => one.isAdopted)?.index ?? null;
      if (inUse !== shownInUse) {
        shownInUse = inUse;
        const card = all.find((one) => indexOf(one) === inUse);
        card?.scrollIntoView({ block: "nearest", inline: "nearest" });
      }
      if (state.takesFocus || hadFocus) moveTo(all.indexOf(current));
    };
    redraw[element] = draw;
    return (next) => {
      state = next;
      draw();
    };
  };
  define("samples", stripOf("samples", "Samples"));
  define("branches", stripOf("branches", "Branches"));
  for (const [element, name] of [
    ["samples", "sample-pictures"],
    ["branches", "branch-pictures"]
  ])
    define(name, () => (next) => {
      pictures2[element] = next.pictures;
      redraw[element]?.();
    });

  // src/elements/scorecard.ts
  var WIDTH = 276;
  var HEIGHT = 66;
  var TOP = 8;
  var LEFT = 30;
  var NARROW_PX = 11;
  var SHAPES2 = { usual: "●", unusual: "▲", extreme: "■" };
  var COLORS2 = ["var(--pd-line-1)", "var(--pd-line-2)", "var(--pd-line-3)"];
  var EMPTY = "Select up to three agents to see speed, acceleration and gap.";
  var setCharts = (_state) => {
  };
  var written2 = (value, digits = 1) => value.toFixed(digits).replace("-", "−");
  function chart({ title, lines }, time, ids) {
    const known = lines.flat().filter((value) => value !== null);
    if (!known.length) return null;
    const low = Math.min(0, ...known);
    const high = Math.max(low + 1, ...known);
    const [first, last] = [time[0], time.at(-1) ?? 0];
    const x = (t) => LEFT + (t - first) / (last - first || 1) * (WIDTH - LEFT - 4);
    const y = (value) => TOP + (1 - (value - low) / (high - low)) * (HEIGHT - TOP - 4);
    const picture2 = svg("svg", "", {
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
      role: "img",
      "aria-label": `${title} of ${ids.join(", ")}`
    });
    for (const value of low < 0 ? [low, 0, high] : [low, high]) {
      const grid = { x1: LEFT, x2: WIDTH - 4, y1: y(value), y2: y(value) };
      picture2.append(svg("line", "pd-chart-grid", grid));
      const isNarrow = Math.min(y(low) - y(0), y(0) - y(high)) < NARROW_PX;
      if (value === 0 && low < 0 && isNarrow) continue;
      const text = value === 0 ? "0" : written2(value, Math.abs(value) >= 100 ? 0 : 1);
      picture2.append(svg("text", "pd-chart-text", { x: LEFT - 4, y: y(value) + 3.5 }, text));
    }
    for (const [index, line] of lines.entries()) {
      const points = line.map((value, step2) => value === null ? null : [x(time[step2]), y(value)]);
      const drawn = svg("path", "pd-chart-line", { d: along(points) });
      drawn.style.stroke = COLORS2[index];
      picture2.append(drawn);
    }
    const playhead = svg("line", "pd-chart-head", { y1: TOP - 4, y2: HEIGHT - 2 });
    picture2.append(playhead);
    const box = make("div", "pd-chart");
    const values = lines.map((_, index) => {
      const value = make("span", "pd-chart-value");
      value.style.color = COLORS2[index];
      return value;
    });
    const heading = make("div", "pd-chart-title", {}, title);
    heading.append(...values);
    box.append(heading, picture2);
    const step = (last - first) / Math.max(time.length - 1, 1) || 1;
    const move = (t) => {
      playhead.setAttribute("x1", String(x(t)));
      playhead.setAttribute("x2", String(x(t)));
      const at = clamp(Math.round((t - first) / step), 0, time.length - 1);
      for (const [index, line] of lines.entries()) {
        const value = line[at];
        const text = value === null ? "–" : written2(value);
        if (values[index].textContent !== text) values[index].textContent = text;
      }
    };
    return { box, move };
  }
  define("scorecard", (api) => {
    const drawer = make("div", "pd-solid pd-agents pd-score", { role: "region", "aria-label": "Scorecard" });
    drawer.hidden = true;
    const send2 = (event) => {
      const covered = (drawer.offsetLeft + drawer.offsetWidth) / Math.max(pictureSize().width, 1);
      api.send({ ...event, covered: Math.min(covered, 1) });
    };
    const head3 = make("div", "pd-agents-head");
    head3.append(
      make("b", "pd-score-title", {}, "Scorecard"),
      closeButton("Close the scorecard", "I", () => send2({ kind: "close" }))
    );
    const columns = make("div", "pd-score-row pd-score-head");
    for (const [name, text] of [
      ["dot", ""],
      ["name", "Motor vehicles"],
      ["value", "scene"],
      ["usual", "usual"]
    ])
      columns.append(make("span", `pd-score-${name}`, {}, text));
    columns.title = "Usual: 5 to 95 % of recorded scenes";
    const list = make("div", "pd-score-rows", { role: "group", "aria-label": "Metrics" });
    const charts = make("div", "pd-charts");
    const foot = make("label", "pd-score-draw");
    const draws = make("input", "", { type: "checkbox" });
    draws.addEventListener("change", () => send2({ kind: "draw", value: draws.checked }));
    foot.append(draws, make("span", "", {}, "Draw findings in the scene"));
    drawer.append(head3, columns, list, foot, charts);
    api.box.append(drawer);
    let moves = [];
    let now = 0;
    function showTime(time) {
      now = time;
      if (!drawer.hidden) for (const move of moves) move(time);
    }
    setCharts = ({ charts: all, time, ids }) => {
      const made = all.map((one) => chart(one, time, ids)).filter((one) => one !== null);
      moves = made.map((one) => one.move);
      const legend = make("div", "pd-chart-legend");
      ids.forEach((id, index) => {
        const name = make("span", "", { title: id }, id);
        name.style.setProperty("--line", COLORS2[index]);
        legend.append(name);
      });
      const empty = make("div", "pd-score-note", {}, EMPTY);
      charts.replaceChildren(...made.length ? [legend, ...made.map((one) => one.box)] : [empty]);
      showTime(now);
    };
    playheadMoved.listen(showTime);
    function rowOf(row) {
      const where = row.where ? `The worst: ${row.where}` : "No agent stands out";
      const item = button("pd-score-row", "", () => send2({ kind: "row", name: row.name }), {
        title: `${row.meaning} ${where}`,
        "aria-expanded": String(row.findings !== null)
      });
      item.disabled = !row.where;
      const name = make("span", "pd-score-name", {}, row.title);
      if (row.mark) name.append(make("i", `pd-score-mark pd-score-${row.mark}`));
      const dot = `pd-score-dot pd-${row.tone}`;
      item.append(
        make("span", dot, { role: "img", "aria-label": row.level }, SHAPES2[row.level]),
        name,
        make("span", "pd-score-value", {}, row.value),
        make("span", "pd-score-usual", {}, row.usual)
      );
      return item;
    }
    function detail(row, state) {
      const label = `Findings: ${row.title}`;
      const box = make("div", "pd-score-detail", { role: "group", "aria-label": label });
      for (const { id, agent, text, time, isChosen } of row.findings ?? []) {
        const item = button("pd-score-finding", "", () => send2({ kind: "finding", id }), {
          title: `${agent} ${text}, ${time}`,
          "aria-current": String(isChosen)
        });
        item.append(
          make("b", "", {}, agent),
          make("span", "pd-score-text", {}, text),
          make("span", "pd-score-time", {}, time)
        );
        box.append(item);
        if (!isChosen || !(state.isSearching || state.cures.length)) continue;
        const cures = make("div", "pd-score-cures");
        if (state.isSearching) cures.append(make("span", "pd-score-note", {}, "Looking for repairs ..."));
        for (const name of state.cures) cures.append(button("", name, () => send2({ kind: "cure", name })));
        box.append(cures);
      }
      if (row.more) box.append(make("div", "pd-score-note", {}, `and ${row.more} more`));
      return box;
    }
    return (state) => {
      drawer.hidden = !state.isOpen;
      if (!state.isOpen) return;
      draws.checked = state.draws;
      fill(
        list,
        { ...state, draws: null },
        () => state.rows.flatMap((row) => row.findings ? [rowOf(row), detail(row, state)] : [rowOf(row)])
      );
    };
  });
  define("charts", () => (state) => setCharts(state));

  // src/elements/status.ts
  var LINE_PX = 28;
  var NOTHING2 = "No problems with agents, road or guidance.";
  var ICONS = {
    collision: "M2 6h6v5H2zM9 4l6-1 1 5-6 1zM11.5 11.5l1 2M14 11l2 1M9 12.5l-1 2",
    road: "M6 2 3 16M12 2l3 14M9 3v3M9 8v3M9 13v3",
    speed: "M3 13a7 7 0 1 1 12 0M9 12l4-5",
    against: "M6 15V3M3 6l3-3 3 3M12 3v12M9 12l3 3 3-3",
    goal: "M5 16V3h8l-2 3 2 3H5",
    beyond: "M5 2 3 16M11 2l2 14M8 3v2M8 7v1M5 11h6M15 5l2 3-2 3",
    past: "M9 4v5l3 2M3 9a6 6 0 1 0 2-4.5M3 3v3h3",
    bend: "M4 16c0-7 10-4 10-13M8 16c0-5 10-3 10-13"
  };
  define("status", (api) => {
    const folded = {};
    let isOpen = false;
    let state = null;
    const unsaved = make("div", "pd-solid pd-unsaved", { role: "alert" });
    const unsavedText = make("span", "pd-clipped");
    unsaved.append(
      unsavedText,
      button("pd-strong", "Download", () => api.send({ kind: "download" }))
    );
    const list = make("div", "pd-solid pd-problems", { role: "dialog", "aria-label": "Problems" });
    const rows = make("div", "pd-problem-rows");
    const detail = make("div", "pd-problem-detail");
    const sentence = make("div", "pd-problem-sentence", { role: "status" });
    const cures = make("div", "pd-problem-cures");
    detail.append(sentence, cures);
    list.append(rows, detail);
    const chip = make("div", "pd-solid pd-chip");
    const main = button("pd-chip-main", "", () => toggle(!isOpen));
    const text = make("span", "pd-clipped", { role: "status", "aria-label": "Status" });
    const caret = make("span", "pd-caret", {}, "▴");
    main.append(make("span", "pd-dot"), text, caret);
    chip.append(main);
    api.box.append(list, unsaved, chip);
    const items = () => [...rows.querySelectorAll(".pd-problem-row")];
    const place = (id) => items().findIndex((item) => item.dataset.problem === id);
    const free = () => {
      const whole = root.getBoundingClientRect();
      if (!isOpen || !whole.width) return 1;
      return clamp((list.getBoundingClientRect().left - whole.left) / whole.width, 0, 1);
    };
    const choose = (id) => api.send({ kind: "choose", value: id, free: free() });
    let mostLines = 0;
    function fit() {
      mostLines = Math.max(mostLines, rows.childElementCount);
      list.style.setProperty("--pd-lines", String(mostLines));
    }
    function toggle(wanted) {
      const wasOpen = isOpen;
      isOpen = wanted;
      list.hidden = !isOpen;
      if (!wasOpen) mostLines = 0;
      fit();
      if (isOpen !== wasOpen) api.send({ kind: "list", isOpen, free: free() });
      root.classList.toggle("pd-lists-problems", isOpen);
      main.setAttribute("aria-expanded", String(isOpen));
      caret.textContent = isOpen ? "▾" : "▴";
    }
    function rowOf(row) {
      const item = button("pd-problem-row", "", () => choose(row.id), { title: row.hint });
      item.dataset.problem = row.id;
      item.dataset.severity = row.severity;
      item.append(
        icon(ICONS[row.icon] ?? ICONS.collision, 18),
        make("span", "pd-clipped", {}, row.text),
        make("span", "pd-problem-time", {}, row.time)
      );
      return item;
    }
    let drawn = "";
    function drawRows() {
      if (!state) return;
      const wanted = JSON.stringify([state.groups, folded]);
      if (wanted !== drawn) {
        drawn = wanted;
        const top = rows.scrollTop;
        const focused = document.activeElement?.getAttribute("data-problem");
        const groups = state.groups.filter((group) => group.rows.length);
        const parts = groups.flatMap((group, place2) => {
          const isFolded = folded[group.name] ?? !(place2 === 0 && ["new", "notices"].includes(group.name));
          const fold = () => {
            folded[group.name] = !isFolded;
            drawRows();
          };
          const head3 = button("pd-problem-group", group.title, fold, { "aria-expanded": `${!isFolded}` });
          head3.dataset.problem = group.name;
          if (isFolded) return [head3];
          const more = make("div", "pd-problem-more", {}, `... and ${group.more} more`);
          return [head3, ...group.rows.map(rowOf), ...group.more ? [more] : []];
        });
        rows.replaceChildren(...parts.length ? parts : [make("div", "pd-problem-more", {}, NOTHING2)]);
        detail.hidden = !items().length;
        if (isOpen) fit();
        rows.scrollTop = top;
        if (focused) parts.find((part) => part.dataset.problem === focused)?.focus({ preventScroll: true });
      }
      for (const item of items()) item.setAttribute("aria-current", String(item.dataset.problem === state.active?.id));
    }
    api.box.addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || !isOpen) return;
      toggle(false);
      main.focus();
      event.stopPropagation();
    });
    api.box.addEventListener("keydown", (event) => {
      if (!isOpen || hasModifier(event)) return;
      const step = linesWalked(event, rows.clientHeight / LINE_PX);
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      const all = items();
      if (!all.length) return;
      const at = all.indexOf(document.activeElement);
      const begin = at < 0 ? place(state?.active?.id) : at;
      const next = all[clamp(begin + step, 0, all.length - 1)];
      next.focus();
      next.scrollIntoView({ block: "nearest" });
      choose(next.dataset.problem ?? "");
    });
    function drawCures() {
      const active = state?.active;
      sentence.textContent = active ? [active.message, active.note].filter(Boolean).join(" ") : "Choose a row to see it and what helps.";
      const made = (active?.cures ?? []).map(
        (label) => button("pd-strong", label, () => api.send({ kind: "cure", value: label }))
      );
      if (active?.ignore) made.push(button("pd-quiet", active.ignore, () => api.send({ kind: "ignore" })));
      cures.replaceChildren(...made);
    }
    toggle(false);
    let drawnCures = "";
    let numClosed = 0;
    return (next) => {
      if (next.numClosed > numClosed) toggle(false);
      numClosed = next.numClosed;
      const isCuring = cures.contains(document.activeElement);
      const former2 = place(state?.active?.id);
      state = next;
      chip.dataset.tone = next.tone;
      if (text.textContent !== next.text) text.textContent = next.text;
      text.title = next.text;
      unsaved.hidden = !next.unsaved;
      unsavedText.textContent = unsavedText.title = next.unsaved;
      api.box.classList.toggle("pd-has-unsaved", Boolean(next.unsaved));
      drawRows();
      const wanted = JSON.stringify(next.active);
      if (wanted === drawnCures) return;
      drawnCures = wanted;
      drawCures();
      if (!isCuring || !isOpen) return;
      const all = items();
      const now = place(next.active?.id);
      const row = all[now >= 0 ? now : clamp(former2, 0, Math.max(all.length - 1, 0))];
      (row ?? main).focus({ preventScroll: true });
    };
  });

  // src/clock.ts
  var MOST_TICKS = 24;
  var secondsOf = (step, axis2) => step * axis2.stepS;
  function inWords(step, axis2) {
    const seconds = Math.abs(secondsOf(step, axis2)).toFixed(1);
    return `${step < 0 && seconds !== "0.0" ? "−" : ""}${seconds} s`;
  }
  function stepAfter(seconds, head3, { beginStep, endStep, stepS }) {
    if (!head3.isPlaying) return head3.step;
    const step = head3.step + seconds / stepS * head3.speed;
    const sign = Math.sign(head3.speed);
    const [ahead, behind] = sign > 0 ? [endStep, beginStep] : [beginStep, endStep];
    const passed = sign * (step - ahead);
    if (passed <= 0) return step;
    const length = endStep - beginStep;
    return !head3.loops || length <= 0 ? ahead : behind + sign * (passed % length);
  }
  function ticks(axis2) {
    const first = Math.ceil(secondsOf(axis2.firstStep, axis2) - 1e-6);
    const last = Math.floor(secondsOf(axis2.lastStep, axis2) + 1e-6);
    const every = Math.max(1, Math.ceil((last - first) / MOST_TICKS));
    const all = Array.from({ length: last - first + 1 }, (_, index) => first + index);
    return all.filter((second) => second % every === 0);
  }

  // src/elements/timeline.ts
  var SCRUB_PAUSE_MS = 40;
  var SOON_STEPS = 3;
  var LEFT_OPEN = 0.7;
  var axis = { firstStep: -50, lastStep: 59, beginStep: -50, endStep: 59, stepS: 0.1, marks: [] };
  var head2 = { step: 0, isPlaying: false, speed: 1, loops: true };
  var since = performance.now();
  var isScrubbing = false;
  var drawHead = (_step) => {
  };
  clock.step = () => stepAfter((performance.now() - since) / 1e3, head2, axis);
  function icon2(...shapes) {
    const picture2 = svg("svg", "", { viewBox: "0 0 16 16", width: 16, height: 16 });
    for (const [d, isLine] of shapes)
      picture2.append(
        svg(
          "path",
          "",
          isLine ? { d, fill: "none", stroke: "currentColor", "stroke-width": 1.6 } : { d, fill: "currentColor" }
        )
      );
    return picture2;
  }
  var playIcon = icon2(["M4 2.5v11l9.5-5.5z", false]);
  var pauseIcon = icon2(["M3.5 2.5h3v11h-3z", false], ["M9.5 2.5h3v11h-3z", false]);
  var loopIcon = icon2(["M4.5 5h6.2a2.8 2.8 0 0 1 0 6H4.8a2.8 2.8 0 0 1-2.6-3.8", true], ["M6.5 1.8v6.4L2.8 5z", false]);
  define("timeline", (api) => {
    const bar = make("div", "pd-solid pd-timeline-bar", { role: "group", "aria-label": "Timeline" });
    const action = (name, title, kind) => button("", "", () => api.send({ kind }), { "aria-label": name, title });
    const play = action("Play", "Play or pause (Space)", "play");
    const current = action("t = 0", "Go to t = 0, where edits act", "current");
    current.textContent = "t = 0";
    const shown = make("output", "pd-time", { "aria-label": "Time shown" });
    const rail = make("div", "pd-rail");
    const named = { role: "slider", "aria-label": "Time", "aria-orientation": "horizontal", tabindex: 0 };
    const track2 = make("div", "pd-track", named);
    const lane = make("div", "pd-lane");
    const past = make("div", "pd-past");
    const future = make("div", "pd-future");
    lane.append(past, future);
    const scale = make("div", "pd-scale");
    const knob = make("div", "pd-knob");
    const problems = make("div", "pd-marks");
    const hint = make("div", "pd-solid pd-mark-hint", { role: "tooltip" });
    hint.hidden = true;
    track2.append(lane, scale, knob);
    rail.append(track2, problems, hint);
    const speed = action("Speed", "Speed of playback", "speed");
    speed.classList.add("pd-speed");
    const loop = action("Loop", "Begin again at the end", "loop");
    loop.append(loopIcon);
    bar.append(play, current, shown, rail, speed, loop);
    api.box.append(bar);
    const length = () => Math.max(axis.lastStep - axis.firstStep, 1);
    const inside = (step) => clamp(step, axis.firstStep, axis.lastStep);
    const share = (step) => 100 * (inside(step) - axis.firstStep) / length();
    track.box = rail;
    track.share = (step) => (step - axis.firstStep) / length();
    function drawAxis() {
      const zero = share(0);
      past.style.width = `${zero}%`;
      future.style.left = `${zero}%`;
      future.style.width = `${share(axis.endStep) - zero}%`;
      scale.replaceChildren(
        ...ticks(axis).map((second) => {
          const mark = make("div", second === 0 ? "pd-second pd-zero" : "pd-second");
          mark.style.left = `${share(second / axis.stepS)}%`;
          mark.append(make("span", "", {}, String(second).replace("-", "−")));
          return mark;
        })
      );
      track2.setAttribute("aria-valuemin", secondsOf(axis.firstStep, axis).toFixed(1));
      track2.setAttribute("aria-valuemax", secondsOf(axis.lastStep, axis).toFixed(1));
      track.stepS = axis.stepS;
      track.drawn.tell();
    }
    function markOf({ kind, step, text }) {
      const what = { problem: "Problem", notice: "Notice", finding: "Finding" }[kind];
      const mark = button(`pd-mark pd-${kind}`, "", () => api.send({ kind, value: step }), {
        "aria-label": `${what} at ${inWords(step, axis)}`
      });
      mark.style.left = `${share(step)}%`;
      mark.addEventListener("pointerenter", () => {
        hint.textContent = text;
        hint.hidden = false;
        const [half, width] = [hint.offsetWidth / 2, track2.offsetWidth];
        hint.style.left = `${clamp(share(step) / 100 * width, half - 90, width - half + 90)}px`;
      });
      mark.addEventListener("pointerleave", () => {
        hint.hidden = true;
      });
      return mark;
    }
    let wasPlaying = null;
    drawHead = (step) => {
      playheadMoved.tell(secondsOf(step, axis));
      knob.style.left = `${share(step)}%`;
      const words = inWords(step, axis);
      if (shown.textContent !== words) {
        shown.textContent = words;
        track2.setAttribute("aria-valuenow", secondsOf(step, axis).toFixed(1));
        track2.setAttribute("aria-valuetext", words);
      }
      if (wasPlaying !== head2.isPlaying) {
        wasPlaying = head2.isPlaying;
        play.setAttribute("aria-label", head2.isPlaying ? "Pause" : "Play");
        play.replaceChildren(head2.isPlaying ? pauseIcon : playIcon);
      }
      speed.textContent = `${head2.speed}×`.replace("-", "−");
      speed.setAttribute("aria-label", `Speed ${speed.textContent}`);
      loop.setAttribute("aria-pressed", String(head2.loops));
    };
    let [wanted, sent] = [null, null];
    const { ask: tell } = paced(SCRUB_PAUSE_MS, () => {
      if (wanted === null || wanted === sent) return false;
      sent = wanted;
      api.send({ kind: "seek", value: sent });
      return true;
    });
    function scrub(event) {
      const box = track2.getBoundingClientRect();
      const part = (event.clientX - box.left) / Math.max(box.width, 1);
      const step = inside(Math.round(axis.firstStep + part * (axis.lastStep - axis.firstStep)));
      wanted = step;
      head2 = { ...head2, step, isPlaying: false };
      drawHead(step);
      tell();
    }
    track2.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      isScrubbing = true;
      sent = null;
      track2.setPointerCapture(event.pointerId);
      scrub(event);
    });
    track2.addEventListener("pointermove", (event) => {
      if (isScrubbing) scrub(event);
    });
    for (const type of ["pointerup", "pointercancel"])
      track2.addEventListener(type, () => {
        isScrubbing = false;
      });
    hearFirst("keydown", (event) => {
      const isOnTrack = event.target === track2;
      const steps = { ArrowLeft: -1, ArrowRight: 1, ",": -1, ".": 1, ...isOnTrack && { PageDown: -10, PageUp: 10 } }[event.key];
      const end = isOnTrack ? { Home: axis.firstStep, End: axis.lastStep }[event.key] : void 0;
      if (!(steps || end !== void 0) || hasModifier(event) || isTyping(event)) return;
      if (within(event, "[role=slider]:not(.pd-track), [role=tab], [role=option], [role=dialog]")) return;
      event.preventDefault();
      event.stopPropagation();
      if (end !== void 0) api.send({ kind: "seek", value: end });
      else if (steps) api.send({ kind: "step", value: steps * (event.shiftKey ? 10 : 1) });
    });
    everyFrame(() => {
      if (head2.isPlaying && !isScrubbing) drawHead(clock.step());
    });
    drawAxis();
    drawHead(head2.step);
    return (state) => {
      axis = state;
      drawAxis();
      hint.hidden = true;
      fill(problems, state, () => state.marks.map(markOf));
      drawHead(clock.step());
    };
  });
  define("playhead", () => (state) => {
    if (isScrubbing) return;
    const gap = state.step - clock.step();
    const isRun = state.isPlaying && head2.isPlaying && state.speed === head2.speed;
    const isSoon = isRun && Math.abs(gap) < SOON_STEPS;
    head2 = { ...state, step: isSoon ? state.step - LEFT_OPEN * gap : state.step };
    since = performance.now();
    drawHead(head2.step);
  });

  // src/elements/speed_curve.ts
  var HEIGHT2 = 64;
  var TOP2 = 14;
  var BOTTOM = 5;
  var GUTTER = 32;
  var PULL_PAUSE_MS = 30;
  var KEY_MPS = 0.5;
  var FINE = 0.2;
  var KEY_FOLDED = "pd-speed-folded";
  var ROOMY_PX = 700;
  var KEY_REST_MS = 800;
  define("speedCurve", (api) => {
    let state = { agent: "", beginStep: 0, speeds: [], former: [], harsh: [] };
    let top = 10;
    let pull = null;
    let keyRest;
    const box = make("div", "pd-solid pd-speed-curve", { role: "group", tabindex: 0 });
    const picture2 = svg("svg", "", { "aria-hidden": "true" });
    const title = make("span", "pd-speed-title");
    const value = make("output", "pd-speed-value");
    const isFolded = () => recall(KEY_FOLDED) ?? window.innerHeight < ROOMY_PX;
    const fold = button("pd-speed-fold", "", () => {
      remember(KEY_FOLDED, !isFolded());
      draw();
    });
    fold.append(icon("M1.5 12.5h2c3 0 3-8 6-8s2 4 5 4", 16, "pd-speed-icon"));
    fold.setAttribute("aria-label", "Curve of speed");
    track.box?.after(fold);
    box.append(picture2, title, value);
    api.box.append(box);
    const speedAt = (step) => state.speeds[step - state.beginStep] ?? null;
    const left = () => (track.box?.getBoundingClientRect().left ?? 0) - box.getBoundingClientRect().left;
    const width = () => track.box?.offsetWidth ?? 0;
    const x = (step) => left() + track.share(step) * width();
    const y = (speed) => HEIGHT2 - BOTTOM - speed / top * (HEIGHT2 - TOP2 - BOTTOM);
    function stepAt(event) {
      const at = event.clientX - box.getBoundingClientRect().left - left();
      const share = (step) => track.share(step) * width();
      return Math.round((at - share(0)) / (share(1) - share(0) || 1));
    }
    function draw() {
      const isShown = Boolean(state.agent) && !isFolded();
      box.hidden = !isShown;
      root.classList.toggle("pd-shows-speed", isShown);
      fold.title = isFolded() ? "Show speed of one selected agent" : "Hide speed of the selected agent";
      fold.setAttribute("aria-pressed", String(!isFolded()));
      if (!isShown) return;
      box.setAttribute("aria-label", `Speed of ${state.agent}: arrows up and down change it at the time shown`);
      title.textContent = `Speed of ${state.agent}, m/s`;
      if (!pull) {
        const known = [...state.speeds, ...state.former].filter((one) => one !== null);
        top = Math.max(5, Math.ceil(1.15 * Math.max(...known) / 5) * 5);
      }
      const pixel = (speed, index) => speed === null ? null : [x(state.beginStep + index), y(speed)];
      const line = (name, speeds) => svg("path", name, { d: along(speeds.map(pixel)) });
      const lastStep = state.beginStep + state.speeds.length - 1;
      const [begin, zero, end2] = [x(state.beginStep), x(0), x(lastStep)];
      title.style.maxWidth = `${begin - GUTTER}px`;
      const grid = [0, top / 2, top].flatMap((speed) => [
        svg("line", "pd-chart-grid", { x1: begin, x2: end2, y1: y(speed), y2: y(speed) }),
        svg("text", "pd-chart-text", { x: begin - 5, y: y(speed) + 3.5 }, String(speed))
      ]);
      const harsh = new Set(state.harsh);
      const hard = state.speeds.map((speed, index) => harsh.has(state.beginStep + index) ? speed : null);
      picture2.replaceChildren(
        ...grid,
        svg("rect", "pd-speed-past", { x: begin, y: 0, width: Math.max(zero - begin, 0), height: HEIGHT2 }),
        line("pd-speed-former", state.former),
        line("pd-speed-line", state.speeds),
        line("pd-speed-line pd-speed-harsh", hard),
        head3,
        dot
      );
      point(pull?.step ?? hovered);
      drawHead2();
    }
    const head3 = svg("line", "pd-chart-head", { y1: 0, y2: HEIGHT2 });
    function drawHead2() {
      if (box.hidden) return;
      const at = String(x(clock.step()));
      head3.setAttribute("x1", at);
      head3.setAttribute("x2", at);
    }
    const dot = svg("circle", "pd-speed-dot", { r: 5 });
    let hovered = null;
    function point(step) {
      const speed = step === null ? null : speedAt(step);
      dot.style.display = speed === null || step === null ? "none" : "";
      if (speed === null || step === null) {
        value.textContent = "";
        return;
      }
      dot.setAttribute("cx", String(x(step)));
      dot.setAttribute("cy", String(y(speed)));
      dot.classList.toggle("pd-is-past", step < 0);
      const words = step < 0 ? "the past stays" : harshWords(step);
      value.textContent = `${speed.toFixed(1)} m/s at ${inWords(step, track)}${words ? `, ${words}` : ""}`;
    }
    const harshWords = (step) => state.harsh.includes(step) ? "harsh" : "";
    const { ask: tell, stop } = paced(PULL_PAUSE_MS, () => {
      if (!pull) return false;
      api.send({ kind: "pull", step: pull.step, speed: pull.speed });
      return true;
    });
    function end(kind) {
      if (!pull) return;
      stop();
      if (kind === "release" && pull.speed !== pull.from) api.send({ kind: "pull", step: pull.step, speed: pull.speed });
      api.send({ kind });
      pull = null;
      draw();
    }
    box.addEventListener("pointermove", (event) => {
      if (pull) return;
      hovered = stepAt(event);
      point(hovered);
    });
    box.addEventListener("pointerleave", () => {
      hovered = null;
      if (!pull) point(null);
    });
    box.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || pull) return;
      const step = stepAt(event);
      const from = step < 0 ? null : speedAt(step);
      if (from === null) return;
      settleKeys();
      box.setPointerCapture(event.pointerId);
      pull = { id: event.pointerId, step, startY: event.clientY, from, speed: from };
      point(step);
    });
    listen(box, "pointermove", (event) => {
      if (pull?.id !== event.pointerId) return;
      const perPixel = top / (HEIGHT2 - TOP2 - BOTTOM);
      const moved = (pull.startY - event.clientY) * perPixel * (event.shiftKey ? FINE : 1);
      const speed = Math.max(Math.round((pull.from + moved) * 10) / 10, 0);
      if (speed === pull.speed) return;
      pull.speed = speed;
      tell();
    });
    followPress(
      () => pull,
      () => end("release"),
      () => end("cancel")
    );
    function settleKeys() {
      if (keyRest === void 0) return;
      clearTimeout(keyRest);
      keyRest = void 0;
      api.send({ kind: "release" });
    }
    let keyed = 0;
    box.addEventListener("keydown", (event) => {
      const sign = { ArrowUp: 1, ArrowDown: -1 }[event.key];
      const step = Math.round(clock.step());
      const speed = step < 0 ? null : speedAt(step);
      if (!sign || speed === null || pull) return;
      event.preventDefault();
      event.stopPropagation();
      if (keyRest === void 0) keyed = speed;
      clearTimeout(keyRest);
      keyed = clamp(keyed + sign * KEY_MPS * (event.shiftKey ? FINE : 1), 0, 60);
      api.send({ kind: "pull", step, speed: Math.round(keyed * 100) / 100 });
      keyRest = setTimeout(settleKeys, KEY_REST_MS);
    });
    playheadMoved.listen(drawHead2);
    track.drawn.listen(draw);
    const resized = new ResizeObserver(draw);
    if (track.box) resized.observe(track.box);
    onDispose(() => resized.disconnect());
    return (next) => {
      if (next.agent !== state.agent) pull = null;
      state = next;
      draw();
    };
  });

  // src/elements/time_handles.ts
  var PAUSE_MS3 = 40;
  var STILL_PX3 = 3;
  define("timeHandles", (api) => {
    const lane = make("div", "pd-time-handles");
    track.box?.append(lane);
    let state = { handles: [] };
    let hold = null;
    const width = () => track.box?.offsetWidth ?? 0;
    function picture2({ kind, step, text, isChosen }, index) {
      const at = hold?.index === index && hold.step !== null ? hold.step : step;
      const words = hold?.index === index ? `${text.replace(/ [\d.]+ s$/, "")} ${inWords(at, track)}` : text;
      const handle = make("div", `pd-time-handle pd-guide-${kind}`, {
        role: "slider",
        tabindex: 0,
        title: `${words}. Drag it, or press an arrow key`,
        "aria-label": words,
        "aria-valuenow": (at * track.stepS).toFixed(1)
      });
      handle.classList.toggle("pd-is-chosen", isChosen);
      handle.style.left = `${(100 * track.share(at)).toFixed(3)}%`;
      handle.append(kind === "lock" ? padlock() : guidanceIcon(kind, 13));
      handle.addEventListener("pointerdown", (event) => {
        if (event.button !== 0 || hold) return;
        event.stopPropagation();
        hold = { id: event.pointerId, index, startX: event.clientX, step: null };
        api.send({ kind: "grab", index });
      });
      handle.addEventListener("keydown", (event) => {
        const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        if (!by || hold) return;
        event.preventDefault();
        event.stopPropagation();
        api.send({ kind: "grab", index });
        api.send({ kind: "drop", index, step: step + by * (event.shiftKey ? 10 : 1) });
      });
      return handle;
    }
    function draw() {
      const focus = [...lane.children].indexOf(document.activeElement);
      lane.replaceChildren(...state.handles.map(picture2));
      if (focus >= 0) lane.children[focus]?.focus();
    }
    const { ask, stop } = paced(PAUSE_MS3, () => {
      if (hold?.step === null || !hold) return false;
      api.send({ kind: "drag", index: hold.index, step: hold.step });
      return true;
    });
    listen(window, "pointermove", (event) => {
      if (hold?.id !== event.pointerId) return;
      if (hold.step === null && Math.abs(event.clientX - hold.startX) <= STILL_PX3) return;
      const left = (track.box?.getBoundingClientRect().left ?? 0) + track.share(0) * width();
      const step = Math.round((event.clientX - left) / ((track.share(1) - track.share(0)) * width() || 1));
      if (step === (hold.step ?? state.handles[hold.index]?.step)) return;
      hold.step = step;
      ask();
      draw();
    });
    function end(kind) {
      if (!hold) return;
      stop();
      api.send({ kind, index: hold.index, step: kind === "drop" ? hold.step : null });
      hold = null;
      draw();
    }
    followPress(
      () => hold,
      () => end("drop"),
      () => end("cancel")
    );
    track.drawn.listen(draw);
    return (next) => {
      state = next;
      if (hold && hold.index >= state.handles.length) hold = null;
      draw();
    };
  });

  // src/elements/toolbar.ts
  var PATHS = {
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
    help: "M7.2 7.4a2.8 2.8 0 1 1 4.4 2.3c-1 .7-1.6 1.2-1.6 2.5M10 15.2v.4"
  };
  define("toolbar", (api) => {
    const bar = make("div", "pd-solid pd-bar", { role: "toolbar", "aria-label": "Tools" });
    api.box.append(bar);
    root.prepend(api.box);
    const buttons = /* @__PURE__ */ new Map();
    function add(tool) {
      const button2 = make("button", tool.startsGroup ? "pd-group" : "", { type: "button" });
      const press = () => api.send({ kind: "press", icon: tool.icon });
      const release = () => api.send({ kind: "release", icon: tool.icon });
      button2.append(icon(PATHS[tool.icon] ?? guidanceIcons[tool.icon], 20));
      if (tool.isHeld) {
        button2.addEventListener("pointerdown", (event) => {
          button2.setPointerCapture(event.pointerId);
          press();
        });
        button2.addEventListener("lostpointercapture", release);
        button2.addEventListener("keydown", (event) => {
          if (event.key === "Enter" && !event.repeat) press();
        });
        button2.addEventListener("keyup", (event) => {
          if (event.key === "Enter") release();
        });
      } else button2.addEventListener("click", press);
      bar.append(button2);
      buttons.set(tool.icon, button2);
      return button2;
    }
    return ({ tools }) => {
      for (const tool of tools) {
        const button2 = buttons.get(tool.icon) ?? add(tool);
        button2.ariaLabel = button2.dataset.hint = tool.hint;
        button2.setAttribute("aria-pressed", String(tool.isActive));
        button2.setAttribute("aria-disabled", String(!tool.isEnabled));
      }
    };
  });

  // src/elements/tooltip.ts
  var REST_MS = 400;
  var STILL_PX4 = 3;
  define("tooltip", (api) => {
    const tip = new Tip(api.box);
    let at = null;
    let timer;
    let asks = 0;
    let agent = null;
    function tell(next) {
      if (next === agent) return;
      agent = next;
      agentUnderPointer.tell(agent);
    }
    function hide() {
      clearTimeout(timer);
      tip.hide();
      tell(null);
      asks += 1;
    }
    function ask() {
      const seen = at && ray(...at);
      if (!at || !seen) return;
      asks += 1;
      api.send({ at, ray: seen, ask: asks });
    }
    hearFirst(
      "pointermove",
      (event) => {
        const now = isOnPicture(event) && event.buttons === 0 ? local(event) : null;
        if (now && at && distance(now, at) <= STILL_PX4) return;
        hide();
        at = now;
        if (now) timer = setTimeout(ask, REST_MS);
      },
      { passive: true }
    );
    for (const type of ["pointerdown", "wheel", "keydown", "blur"]) hearFirst(type, hide, { passive: true });
    onView(hide);
    return ({ at: point, lines, agent: under, asked }) => {
      if (asked !== asks || !lines.length) return;
      tip.tell(lines, point);
      tell(under);
    };
  });

  // src/elements/view.ts
  var PAN_KEY = "KeyH";
  var MAX_POLAR = 85 * Math.PI / 180;
  var LIMITS = { top: [80, 9900], space: [4, 1500] };
  var MAX_REACH = 8;
  define("view", () => {
    let isTop = null;
    let known = null;
    let isPanKeyHeld = false;
    let pan = null;
    let hasPanned = false;
    function configure() {
      const found = controls();
      if (!found || isTop === null) return;
      known = found;
      keepGestures(found, !isTop);
      found.maxPolarAngle = isTop ? Math.PI : MAX_POLAR;
    }
    function pose(found, camera2, atEnd) {
      const [position, target] = [camera2.position.clone(), camera2.position.clone()];
      found.getPosition(position, atEnd);
      found.getTarget(target, atEnd);
      return { position: toScene(position), target: toScene(target) };
    }
    function look(found, { position, target }, isSmooth) {
      const [from, to] = [toWorld(position.clone()), toWorld(target.clone())];
      found.setLookAt(from.x, from.y, from.z, to.x, to.y, to.z, isSmooth);
    }
    const isOnLayer = (event) => within(event, ".pd-picture") !== null;
    const isOnView = (event) => isOnPicture(event) || isOnLayer(event);
    function zoom(event) {
      const [found, camera2] = [controls(), camera()];
      if (!found || !camera2 || !isOnView(event)) return;
      event.preventDefault();
      event.stopPropagation();
      if (!found.enabled) return;
      const lines = event.deltaMode === 1 ? 16 : 1;
      const rate = event.ctrlKey ? 0.01 : 18e-4;
      const now = pose(found, camera2, true);
      const distance2 = now.position.distanceTo(now.target);
      const [nearest, farthest] = isTop ? LIMITS.top : LIMITS.space;
      const asked = Math.exp(clamp(event.deltaY * lines * rate, -0.6, 0.6));
      const factor = clamp(distance2 * asked, nearest, farthest) / distance2;
      const center = now.target.clone();
      const point = ground(...local(event));
      if (point) {
        const across = center.clone().set(point[0], point[1], 0).sub(now.target);
        if (!isTop && across.length() > 3 * distance2) across.setLength(3 * distance2);
        center.add(across);
      }
      for (const vector of [now.position, now.target]) vector.sub(center).multiplyScalar(factor).add(center);
      look(found, now, true);
    }
    function reach(at, eye) {
      const point = ground(...at);
      if (!point) return null;
      const across = [point[0] - eye.x, point[1] - eye.y];
      const share = MAX_REACH * Math.max(eye.z, 1) / Math.hypot(...across);
      return share >= 1 ? across : [across[0] * share, across[1] * share];
    }
    function startPan(event) {
      if (pan) return;
      hasPanned = false;
      if (!isOnView(event)) return;
      const isKeyed = event.button === 0 && (isPanKeyHeld || isOnLayer(event));
      if (event.button !== 1 && event.button !== 2 && !isKeyed) return;
      const [found, camera2] = [controls(), camera()];
      if (!found?.enabled || !camera2) return;
      if (event.button !== 2) {
        event.preventDefault();
        event.stopPropagation();
      }
      const [start2, at] = [pose(found, camera2, false), local(event)];
      const grabbed = reach(at, start2.position);
      pan = { start: start2, found, pointer: event.pointerId, at, grabbed, hasMoved: false };
      if (event.button !== 2 && !isOnLayer(event)) setCursor();
    }
    function movePan(event) {
      const camera2 = camera();
      if (!pan || !camera2 || event.pointerId !== pan.pointer) return;
      const at = local(event);
      if (!pan.hasMoved && Math.hypot(at[0] - pan.at[0], at[1] - pan.at[1]) < 4) return;
      if (!pan.hasMoved) {
        pan.hasMoved = true;
        setCursor();
      }
      const now = reach(at, pose(pan.found, camera2, false).position);
      if (!now || !pan.grabbed) return;
      const moved = { position: pan.start.position.clone(), target: pan.start.target.clone() };
      for (const vector of [moved.position, moved.target]) {
        vector.x += pan.grabbed[0] - now[0];
        vector.y += pan.grabbed[1] - now[1];
      }
      look(pan.found, moved, false);
    }
    function endPan(event) {
      if (!pan || event.pointerId !== pan.pointer) return;
      hasPanned = pan.hasMoved;
      pan = null;
      setCursor();
    }
    function setCursor() {
      markBody("pd-can-pan", isPanKeyHeld && !pan);
      markBody("pd-pans", pan !== null);
    }
    function holdPanKey(isHeld) {
      isPanKeyHeld = isHeld;
      setCursor();
    }
    function fitDepth(camera2) {
      const found = controls();
      if (!found || isTop === null) return;
      if (known && found !== known) configure();
      const { position, target } = pose(found, camera2, false);
      const distance2 = position.distanceTo(target);
      const near = isTop ? Math.max(1, distance2 * 0.5) : Math.max(0.3, 0.5 * (position.z - 4));
      const far = isTop ? distance2 * 1.5 + 100 : Math.max(3e3, 6 * distance2);
      const isClose = (a, b) => Math.abs(a - b) <= 0.05 * b;
      if (isClose(camera2.near, near) && isClose(camera2.far, far)) return;
      camera2.near = near;
      camera2.far = far;
      camera2.updateProjectionMatrix();
      requestRender();
    }
    hearFirst("wheel", zoom, { passive: false });
    hearFirst("pointerdown", startPan);
    hearFirst("pointermove", movePan);
    hearFirst("pointerup", endPan);
    hearFirst("pointercancel", endPan);
    for (const type of ["click", "contextmenu"])
      hearFirst(type, (event) => {
        if (!hasPanned || !isOnView(event)) return;
        hasPanned = false;
        take(event);
      });
    listen(window, "keydown", (event) => {
      if (isTyping(event)) return;
      if (event.code === PAN_KEY && !hasModifier(event)) holdPanKey(true);
      letKeyGo(event);
    });
    listen(window, "keyup", (event) => {
      if (event.code === PAN_KEY) holdPanKey(false);
    });
    listen(window, "blur", () => holdPanKey(false));
    onView(fitDepth);
    onDispose(() => document.body.classList.remove("pd-can-pan", "pd-pans"));
    return (state) => {
      isTop = state.isTop;
      const found = controls();
      if (found) {
        found.maxPolarAngle = Math.PI;
        keepGestures(found, !isTop);
      }
      known = null;
      requestAnimationFrame(() => requestAnimationFrame(configure));
    };
  });

  // src/main.ts
  install();
})();
