// viser connects to the page's address without its query and last slash. The query has
// the token, and a proxy with a path knows the editor only with the slash.
const post = Worker.prototype.postMessage;
Worker.prototype.postMessage = function (this: Worker, message, ...others: never[]) {
  let told = message;
  if (message?.type === "set_server") {
    const server = new URL(message.server);
    if (server.host === location.host) {
      if (!server.pathname.endsWith("/")) server.pathname += "/";
      const token = new URLSearchParams(location.search).get("token");
      if (token !== null) server.searchParams.set("token", token);
      told = { ...message, server: server.href };
    }
  }
  return post.call(this, told, ...others);
};

// Drawn by the processor, smooth edges cost as much as all else: the picture goes without.
const make = HTMLCanvasElement.prototype.getContext;
function isSlow(): boolean {
  const gl = make.call(document.createElement("canvas"), "webgl2") as WebGL2RenderingContext | null;
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl?.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER);
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /SwiftShader|llvmpipe|softpipe|Basic Render/.test(name);
}
HTMLCanvasElement.prototype.getContext = function (this: HTMLCanvasElement, kind: string, asked?: object) {
  return make.call(this, kind, kind === "webgl2" && asked && isSlow() ? { ...asked, antialias: false } : asked);
} as typeof make;
