/* Built by .ci/client.py from client/ (3569964e281c56fa); not to be edited. */
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
})();
