// The frame that holds every element drawn over the picture.
//
// An element is registered by pdOverlay.define(name, mount). mount(api) builds its DOM
// into api.box and returns update(state). State comes from Python (Overlay.show), events
// go back by api.send({...}) (Overlay.on). Texts are set by textContent only, since ids
// come from files. Elements never take pointer events except where they are .pd-solid.
(() => {
  const former = window.pdOverlay;
  if (former) former.dispose();

  const definitions = new Map();
  const mounted = new Map();
  const waiting = new Map();
  const frameListeners = new Set();
  const cleanups = [];
  let number = 0;
  let answerUuid = null;
  let isAlive = true;
  let heardAt = Date.now();

  const root = document.createElement("div");
  root.id = "pd-overlay";
  document.body.appendChild(root);
  const style = document.createElement("style");
  document.head.appendChild(style);

  const viewer = () => window.__viserMutable;
  const canvas = () => viewer()?.canvas ?? null;

  function fitToCanvas() {
    const element = canvas();
    if (!element) return;
    const box = element.getBoundingClientRect();
    for (const [name, value] of [
      ["left", box.left], ["top", box.top], ["width", box.width], ["height", box.height],
    ]) {
      const text = `${value}px`;
      if (root.style[name] !== text) root.style[name] = text;
    }
  }

  // A point of the scene (x, y, z in metres) in pixels of the picture, or null if it
  // lies behind the camera.
  function project(point) {
    const { camera, nodeRefFromName } = viewer() ?? {};
    const world = nodeRefFromName?.[""];
    const element = canvas();
    if (!camera || !world || !element) return null;
    const vector = camera.position.clone().set(point[0], point[1], point[2] ?? 0);
    world.localToWorld(vector);
    const depth = vector.clone().applyMatrix4(camera.matrixWorldInverse).z;
    if (depth >= 0) return null;
    vector.project(camera);
    return [
      (0.5 + vector.x / 2) * element.clientWidth,
      (0.5 - vector.y / 2) * element.clientHeight,
    ];
  }

  // The ray through a pixel of the picture: [origin, a point further along], in metres.
  function ray(x, y) {
    const { camera, nodeRefFromName } = viewer() ?? {};
    const world = nodeRefFromName?.[""];
    const element = canvas();
    if (!camera || !world || !element) return null;
    const far = camera.position.clone().set(
      (2 * x) / element.clientWidth - 1, 1 - (2 * y) / element.clientHeight, 0.5);
    far.unproject(camera);
    const start = camera.position.clone();
    world.worldToLocal(far);
    world.worldToLocal(start);
    return [[start.x, start.y, start.z], [far.x, far.y, far.z]];
  }

  // The point of the ground (z = 0) under a pixel of the picture, or null for the sky.
  function ground(x, y) {
    const [start, far] = ray(x, y) ?? [];
    const fall = start ? start[2] - far[2] : 0;
    if (fall <= 1e-9) return null;
    const reach = start[2] / fall;
    return [0, 1].map((axis) => start[axis] + reach * (far[axis] - start[axis]));
  }

  function send(name, event) {
    if (answerUuid === null || !viewer()) return;
    number += 1;
    viewer().sendMessage({
      type: "GuiUpdateMessage",
      uuid: answerUuid,
      updates: { value: JSON.stringify({ number, element: name, event }) },
    });
  }

  // Whether a pointer event is the picture's and not that of an element above it.
  const isOnPicture = (event) => event.target === canvas();

  // Where a pointer event is, in pixels of the picture.
  function local(event) {
    const box = canvas().getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  // Keep an event from viser and from the other elements.
  function take(event) {
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  // Whether a left press pans (H is held), whatever mode is on.
  const isPanPress = () => document.body.classList.contains("pd-can-pan");

  function listen(target, type, listener, options) {
    target.addEventListener(type, listener, options);
    cleanups.push(() => target.removeEventListener(type, listener, options));
  }

  // Follow a press that an element has taken to its end: held() is the press, with the
  // pointer's id, or null. release(event) is called when its button is let go, giveUp()
  // when the browser takes the pointer away, and for Escape. Each sets held() to null.
  function followPress({ held, release, giveUp }) {
    listen(window, "pointerup", (event) => {
      if (event.pointerId !== held()?.id || event.button !== 0) return;
      take(event);
      release(event);
    }, { capture: true });
    listen(window, "pointercancel", giveUp);
    listen(window, "blur", giveUp);
    listen(window, "keydown", (event) => {
      if (event.key !== "Escape" || !held()) return;
      take(event);
      giveUp();
    }, { capture: true });
  }

  // Whether a press is one on the picture that a mode may take.
  const isModePress = (event) =>
    event.button === 0 && isOnPicture(event) && !isPanPress();

  function mount(name) {
    const box = document.createElement("div");
    box.className = `pd-element pd-${name}`;
    root.appendChild(box);
    const api = {
      box, root, canvas, viewer, project, ray, ground, listen,
      isOnPicture, local, take, isPanPress, isModePress, followPress,
      send: (event) => send(name, event),
      // Called with the camera once per drawn frame in which the view has changed.
      onView: (listener) => frameListeners.add(listener),
      onDispose: (cleanup) => cleanups.push(cleanup),
      // What the browser keeps for later visits; null where it keeps nothing.
      recall(key) {
        try {
          return JSON.parse(window.localStorage.getItem(key));
        } catch {
          return null;
        }
      },
      remember(key, value) {
        try {
          window.localStorage.setItem(key, JSON.stringify(value));
        } catch {
          // A browser that keeps nothing shows the element as on the first visit.
        }
      },
      // make("button", "pd-key", {type: "button", title: "Undo"}, "Undo")
      make(tag, className = "", attributes = {}, text = "") {
        const element = document.createElement(tag);
        if (className) element.className = className;
        for (const [key, value] of Object.entries(attributes))
          element.setAttribute(key, value);
        if (text) element.textContent = text;
        return element;
      },
    };
    const update = definitions.get(name)(api);
    // What the server has not spoken of yet would be a frame without words.
    box.hidden = Boolean(update);
    mounted.set(name, (state) => {
      box.hidden = false;
      update?.(state);
    });
    if (waiting.has(name)) {
      const state = waiting.get(name);
      waiting.delete(name);
      mounted.get(name)(state);
    }
  }

  let lastView = "";
  function frame() {
    if (!isAlive) return;
    const camera = viewer()?.camera;
    const element = canvas();
    if (camera && element) {
      const view =
        camera.matrixWorld.elements.map((v) => v.toPrecision(7)).join() +
        [camera.fov, element.clientWidth, element.clientHeight].join();
      if (view !== lastView) {
        lastView = view;
        fitToCanvas();
        for (const listener of frameListeners) listener(camera);
      }
    }
    requestAnimationFrame(frame);
  }

  function start() {
    if (!isAlive) return;
    if (!canvas()) {
      setTimeout(start, 50);
      return;
    }
    fitToCanvas();
    const observer = new ResizeObserver(fitToCanvas);
    observer.observe(canvas());
    cleanups.push(() => observer.disconnect());
    listen(window, "resize", fitToCanvas);
    // Space plays, wherever the focus is; it presses no button of ours.
    listen(root, "keyup", (event) => {
      if (event.key === " " && event.target.tagName === "BUTTON") event.preventDefault();
    });
    for (const name of definitions.keys()) mount(name);
    requestAnimationFrame(frame);
    send("page", { kind: "ready" });
  }

  window.pdOverlay = {
    project,
    ground,
    // The picture that was there when the former connection was lost, and since when
    // nothing was heard of this one.
    lostPicture: former?.picture ?? null,
    heardAt: () => heardAt,
    define: (name, factory) => definitions.set(name, factory),
    setStyle: (text) => { style.textContent = text; },
    start(uuid) { answerUuid = uuid; start(); },
    update(name, state) {
      heardAt = Date.now();
      const update = mounted.get(name);
      if (update) update(state);
      else waiting.set(name, state);
    },
    dispose() {
      isAlive = false;
      for (const cleanup of cleanups) cleanup();
      root.remove();
      style.remove();
    },
  };
})();
