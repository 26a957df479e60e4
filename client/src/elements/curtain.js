// Another scenario comes as a whole: the former picture stays until the new road is
// there. The camera and the agents of the page change at once, while it takes a few
// frames to read the meshes of a road; in between it would show one with the other.
// A page that is connected again shows the picture from before the loss in the same way.
pdOverlay.define("curtain", (api) => {
  const LONGEST_MS = 2000;
  // A layer that is as it was, or has nothing in it, never changes. It is not waited
  // for once the others have come, or once so much time and so many frames have gone.
  const REST = { ms: 120, frames: 3 };
  const NOTHING = { ms: 300, frames: 4 };
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

  if (pdOverlay.lostPicture) raise(pdOverlay.lostPicture);

  function raise(canvas) {
    // Still up for the scenario before: what is under it may be half of either.
    if (!still.classList.contains("pd-gone")) return;
    still.width = canvas.width;
    still.height = canvas.height;
    still.getContext("2d").drawImage(canvas, 0, 0);
    still.classList.remove("pd-gone");
  }

  return ({ nodes }) => {
    number += 1;
    const canvas = number > 1 ? api.canvas() : pdOverlay.lostPicture;
    if (!canvas || document.hidden) {
      still.classList.add("pd-gone");
      return;
    }
    const mine = number;
    const start = performance.now();
    const former = nodes.map(meshOf);
    const changed = new Set();
    let quietSince = start;
    let quietFrames = 0;
    raise(canvas);
    function look() {
      if (mine !== number) return;
      const now = performance.now();
      quietFrames += 1;
      nodes.forEach((name, index) => {
        const mesh = meshOf(name);
        if (changed.has(name) || !mesh || mesh === former[index]) return;
        changed.add(name);
        quietSince = now;
        quietFrames = 0;
      });
      const patience = changed.size > 0 ? REST : NOTHING;
      const isQuiet = now - quietSince > patience.ms && quietFrames > patience.frames &&
        !api.viewer()?.messageQueue?.length;
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
