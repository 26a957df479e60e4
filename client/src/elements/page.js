// The page itself: its title, its theme, and what a browser would do with our keys.
pdOverlay.define("page", (api) => {
  api.listen(document, "keydown", (event) => {
    const isTyping = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "");
    if (isTyping) return;
    // Ctrl+A would mark the page's text; the editor selects all agents by it.
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "a")
      event.preventDefault();
  });
  // viser opens its list of commands by Ctrl+K unless a text field has the focus: what is
  // typed next would go into that field. So the field gives the focus away first.
  api.listen(window, "keydown", (event) => {
    const { target, ctrlKey, metaKey } = event;
    const isAsked = (ctrlKey || metaKey) && !event.shiftKey && !event.altKey &&
      event.key.toLowerCase() === "k";
    if (!isAsked || !event.isTrusted || !/^(INPUT|TEXTAREA|SELECT)$/.test(target?.tagName ?? ""))
      return;
    if (target.closest("[role=dialog]")) return;
    api.take(event);
    target.blur();
    document.body.dispatchEvent(new KeyboardEvent("keydown", {
      key: "k", code: "KeyK", ctrlKey, metaKey, bubbles: true, cancelable: true,
    }));
  }, true);
  // viser calls preventDefault for a press on an agent in a passive listener, where it has
  // no effect but an error in the console.
  api.listen(document, "pointerdown", (event) => {
    if (api.isOnPicture(event)) event.preventDefault = () => {};
  }, { capture: true });
  return ({ title, isDark }) => {
    document.title = title;
    api.root.classList.toggle("pd-dark", isDark);
    // Of what we put into viser's panel.
    document.documentElement.classList.toggle("pd-dark-page", isDark);
  };
});

// The theme is the browser's until the user chooses one, which the browser remembers.
pdOverlay.define("theme", (api) => {
  const KEPT = "pd-editor-dark";
  const browsers = window.matchMedia("(prefers-color-scheme: dark)");
  const tell = () => api.send({ isDark: api.recall(KEPT) ?? browsers.matches });
  api.listen(browsers, "change", tell);
  tell();
  return ({ isDark }) => api.remember(KEPT, isDark);
});
