// A lost connection: the picture and the controls stay, but nothing answers any more.
pdOverlay.define("connection", (api) => {
  const TOLD_MS = 6000;
  const ASKS_MS = 2000;
  const FORBIDDEN = 403;
  const bar = api.make("div", "pd-solid pd-banner-bar pd-connection-bar", { role: "alert" });
  const words = api.make("span", "pd-banner-text");
  bar.append(words);
  bar.hidden = true;
  api.box.append(bar);
  // viser gives the page another function for each connection, and for none.
  const { sendMessage } = api.viewer() ?? {};

  // A server that was started anew has another token, with which nothing connects again.
  async function ask(saved) {
    const request = new AbortController();
    api.onDispose(() => request.abort());
    const answer = await fetch(location.href, { cache: "no-store", signal: request.signal })
      .catch(() => null);
    request.abort();
    if (answer?.status === FORBIDDEN) {
      words.textContent = "The editor was started anew, with another address: "
        + `open the one that it printed. ${saved}`;
    } else setTimeout(() => { if (pdOverlay.picture) ask(saved); }, ASKS_MS);
  }
  function lose() {
    const time = new Date(pdOverlay.heardAt()).toLocaleTimeString();
    const isUnsaved = api.root.querySelector(".pd-unsaved:not([hidden])");
    const saved = isUnsaved
      ? "The newest edits are not saved."
      : `Edits up to ${time} are saved.`;
    words.textContent = `Connection lost. ${saved} Reconnecting \u2026`;
    bar.classList.remove("pd-good");
    bar.hidden = false;
    api.root.classList.add("pd-lost");
    // viser empties its picture when it is connected again.
    const picture = api.make("canvas", "pd-still");
    const { width, height } = api.canvas();
    Object.assign(picture, { width, height }).getContext("2d").drawImage(api.canvas(), 0, 0);
    // As large as it is now: the panel beside it goes for a moment.
    picture.style.cssText = `width:${api.canvas().clientWidth}px;height:${api.canvas().clientHeight}px`;
    api.box.prepend(picture);
    pdOverlay.picture = picture;
    ask(saved);
  }
  const watch = setInterval(() => {
    if (api.viewer()?.sendMessage !== sendMessage && !pdOverlay.picture) lose();
  }, 250);
  api.onDispose(() => clearInterval(watch));

  return ({ isNew }) => {
    if (!pdOverlay.lostPicture) return;
    words.textContent = isNew
      ? "Connected to a server that was started anew. Your edits are under \u201cUnfinished work\u201d."
      : "Connected again. All edits are here.";
    bar.classList.add("pd-good");
    bar.hidden = false;
    setTimeout(() => { bar.hidden = bar.classList.contains("pd-good"); }, TOLD_MS);
  };
});
