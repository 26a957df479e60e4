// viser outlines what the pointer is on by 10 px of yellow: from above, a blob that hides
// a small car. The outline of agents is made as thin as their size on the screen allows.
pdOverlay.define("hover_outline", (api) => {
  const WIDTH_PX = 2.5;
  let lookedAt = 0;

  function thin() {
    const { nodeRefFromName } = api.viewer() ?? {};
    const canvas = api.canvas();
    if (!nodeRefFromName || !canvas) return;
    for (const [name, node] of Object.entries(nodeRefFromName)) {
      if (!name.startsWith("/agents/")) continue;
      node?.traverse((part) => {
        const material = part.material;
        if (material?.uniforms?.screenspace === undefined) return;
        material.uniforms.thickness.value = WIDTH_PX;
        material.uniforms.size.value.set(canvas.width, canvas.height);
      });
    }
  }

  // From above it draws its selection box also while an agent is dragged.
  function hideBox() {
    const isDrag = window.__viserPointer?.cameraLockReasons?.().includes("node-drag");
    document.body.classList.toggle("pd-holds-agent", Boolean(isDrag));
    const box = api.viewer()?.canvas2d;
    if (box) box.style.visibility = isDrag ? "hidden" : "";
  }
  // After viser's own listeners, and before the frame is painted.
  for (const type of ["pointermove", "pointerup"])
    api.listen(window, type, () => requestAnimationFrame(hideBox), { passive: true });

  api.listen(window, "pointermove", () => {
    const now = performance.now();
    if (now - lookedAt < 200) return;
    lookedAt = now;
    thin();
  }, { passive: true });
});
