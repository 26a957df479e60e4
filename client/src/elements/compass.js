// Where north is, and how long a stretch of road is: a compass and a scale bar.
pdOverlay.define("compass", (api) => {
  const LONGEST_PX = 120;
  const STEEP_ENOUGH = 0.2; // Sine of the elevation under which a scale says nothing.
  const compass = api.make("button", "pd-solid pd-compass", { type: "button" });
  const dial = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  dial.setAttribute("viewBox", "0 0 40 40");
  dial.setAttribute("aria-hidden", "true");
  const shape = (tag, attributes, text = "") => {
    const part = document.createElementNS(dial.namespaceURI, tag);
    for (const [name, value] of Object.entries(attributes))
      part.setAttribute(name, value);
    part.textContent = text;
    dial.append(part);
  };
  shape("path", { d: "M20 12.5 24.2 23 20 20.8 15.8 23z", class: "pd-north" });
  shape("path", { d: "M20 35 24.2 24.6 20 22.6 15.8 24.6z", class: "pd-south" });
  shape("text", { x: 20, y: 10.5, "text-anchor": "middle" }, "N");
  compass.append(dial);
  const scale = api.make("div", "pd-scalebar", { role: "img" });
  const bar = api.make("div", "pd-scalebar-line");
  const words = api.make("div");
  scale.append(bar, words);
  api.box.append(compass, scale);
  compass.addEventListener("click", () => api.send({ kind: "turn" }));
  let state = { isTop: false, isHeadingUp: false };

  // 1, 2 or 5 times a power of ten, at most ``most``.
  function roundLength(most) {
    const power = 10 ** Math.floor(Math.log10(most));
    return [5, 2, 1].find((digit) => digit * power <= most) * power;
  }

  function draw() {
    const canvas = api.canvas();
    if (!canvas) return;
    const x = canvas.clientWidth / 2;
    const y = canvas.clientHeight / 2;
    const left = api.ground(x - 20, y);
    const right = api.ground(x + 20, y);
    const middle = api.ground(x, y);
    const isSeen = left && right && middle;
    compass.classList.toggle("pd-gone", !isSeen);
    scale.classList.toggle("pd-gone", !isSeen || elevation(middle) < STEEP_ENOUGH);
    if (!isSeen) return;
    const across = [right[0] - left[0], right[1] - left[1]];
    // Screen right is at this angle of the scene; north is a quarter turn on.
    dial.style.transform = `rotate(${Math.atan2(across[1], across[0])}rad)`;
    const metresPerPixel = Math.hypot(...across) / 40;
    const length = roundLength(LONGEST_PX * metresPerPixel);
    bar.style.width = `${length / metresPerPixel}px`;
    const text = length >= 1000 ? `${length / 1000} km` : `${length} m`;
    // In perspective a length holds where it is measured.
    words.textContent = state.isTop ? text : `${text} at the centre`;
    scale.setAttribute("aria-label", `Scale: ${words.textContent}`);
  }

  function elevation(middle) {
    const node = api.viewer().nodeRefFromName[""];
    const eye = node.worldToLocal(api.viewer().camera.position.clone());
    return eye.z / Math.hypot(eye.x - middle[0], eye.y - middle[1], eye.z);
  }

  api.onView(draw);
  return (next) => {
    state = next;
    const hint = !state.isTop
      ? "Compass: turn the view north"
      : state.isHeadingUp
        ? "Compass: focal agent's heading is up. Click for north up"
        : "Compass: north is up. Click for the focal agent's heading up";
    compass.setAttribute("aria-label", hint);
    compass.dataset.hint = hint;
    draw();
  };
});
