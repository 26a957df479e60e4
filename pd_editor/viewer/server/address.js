/* Built by .ci/client.py from client/ (b639318741cf26d1); not to be edited. */
"use strict";
(() => {
  // src/address.ts
  var post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function(message, ...others) {
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
  var make = HTMLCanvasElement.prototype.getContext;
  function isSlow() {
    const gl = make.call(document.createElement("canvas"), "webgl2");
    const info = gl?.getExtension("WEBGL_debug_renderer_info");
    const name = gl?.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER);
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
    return /SwiftShader|llvmpipe|softpipe|Basic Render/.test(name);
  }
  HTMLCanvasElement.prototype.getContext = function(kind, asked) {
    return make.call(this, kind, kind === "webgl2" && asked && isSlow() ? { ...asked, antialias: false } : asked);
  };
})();
