// Another scenario comes as a whole: the former picture stays until the new road is
// there. The camera and the agents of the page change at once, while it takes a few
// frames to read the meshes of a road; in between it would show one with the other.
pdOverlay.define("curtain", (api) => {
  const LONGEST_MS = 2500;
  const QUIET_MS = 300;
  const still = api.make("canvas", "pd-still pd-gone");
  api.box.append(still);
  let number = 0;

  function meshOf(name) {
    let found = "";
    api.viewer()?.nodeRefFromName?.[name]?.traverse?.((part) => {
      if (!found && part.isMesh) found = part.uuid;
    });
    return found;
  }

  function raise(canvas) {
    still.width = canvas.width;
    still.height = canvas.height;
    still.getContext("2d").drawImage(canvas, 0, 0);
    still.classList.remove("pd-gone");
  }

  return ({ nodes }) => {
    const canvas = api.canvas();
    if (!canvas || document.hidden) return;
    number += 1;
    const mine = number;
    const start = performance.now();
    const former = nodes.map(meshOf);
    const changed = new Set();
    let lastChange = start;
    raise(canvas);
    function look() {
      if (mine !== number) return;
      const now = performance.now();
      nodes.forEach((name, index) => {
        const mesh = meshOf(name);
        if (changed.has(name) || !mesh || mesh === former[index]) return;
        changed.add(name);
        lastChange = now;
      });
      // A layer without anything in it never changes.
      const isQuiet = changed.size > 0 && now - lastChange > QUIET_MS;
      const isThere = changed.size === nodes.length || isQuiet;
      if (!isThere && now - start < LONGEST_MS) {
        requestAnimationFrame(look);
        return;
      }
      api.viewer()?.requestRender?.();
      requestAnimationFrame(() => requestAnimationFrame(() => {
        if (mine === number) still.classList.add("pd-gone");
      }));
    }
    requestAnimationFrame(look);
  };
});
