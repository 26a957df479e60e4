// Padlocks beside locked agents: as large on the screen at every zoom, and never one on
// another. A closed padlock keeps the whole trajectory, one with a line its first seconds,
// a hollow one the state alone.
pdOverlay.padlock = () => {
  const NAMESPACE = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(NAMESPACE, "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(NAMESPACE, "path");
  path.setAttribute("d", "M3 7h10v7H3z M5 7V5a3 3 0 0 1 6 0v2");
  svg.append(path);
  return svg;
};

pdOverlay.define("locks", (api) => {
  const SIZE_PX = 18;
  const COMPACT_PX = 9; // half the width of an agent that is too narrow for seconds
  const plates = [];
  let locks = [];

  function plate(index) {
    while (plates.length <= index) {
      const box = api.make("div", "pd-lock", { role: "img" });
      const text = api.make("span", "pd-lock-seconds");
      box.append(pdOverlay.padlock(), text);
      api.box.appendChild(box);
      plates.push({ box, text });
    }
    return plates[index];
  }

  function place() {
    const taken = [];
    locks.forEach(({ point, radius }, index) => {
      const { box } = plate(index);
      const at = api.project(point);
      const beside = api.project([point[0] + radius, point[1], point[2]]);
      const along = api.project([point[0], point[1] + radius, point[2]]);
      if (!at || !beside || !along) {
        box.style.display = "none";
        return;
      }
      const reach = Math.max(
        Math.hypot(beside[0] - at[0], beside[1] - at[1]),
        Math.hypot(along[0] - at[0], along[1] - at[1]));
      box.classList.toggle("pd-compact", reach < COMPACT_PX);
      box.style.display = "";
      const width = box.offsetWidth;
      // Its upper right corner lies on the lower left side of the agent.
      const right = at[0] - reach * Math.SQRT1_2 + 3;
      const top = at[1] + reach * Math.SQRT1_2 - 3;
      const left = right - width;
      const isFree = taken.every((other) =>
        left >= other.right || right <= other.left ||
        Math.abs(top - other.top) >= SIZE_PX);
      // Of padlocks that would cover each other, the first one stands for all.
      if (!isFree) {
        box.style.display = "none";
        return;
      }
      taken.push({ left, right, top });
      box.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
    });
    plates.slice(locks.length).forEach(({ box }) => { box.style.display = "none"; });
  }

  api.onView(place);
  return (state) => {
    locks = state.locks;
    locks.forEach(({ keeps, seconds, label }, index) => {
      const { box, text } = plate(index);
      box.className = `pd-lock pd-lock-${keeps}`;
      box.setAttribute("aria-label", label);
      if (text.textContent !== seconds) text.textContent = seconds;
    });
    place();
  };
});
