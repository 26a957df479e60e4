// Built by .ci/client.py from client/ (5ed4f2ebbddda31c); not to be edited.
"use strict";
(() => {
  // src/address.js
  (() => {
    const post = Worker.prototype.postMessage;
    Worker.prototype.postMessage = function(message, ...others) {
      if (message?.type === "set_server") {
        const server = new URL(message.server);
        if (server.host === location.host) {
          if (!server.pathname.endsWith("/")) server.pathname += "/";
          const token = new URLSearchParams(location.search).get("token");
          if (token !== null) server.searchParams.set("token", token);
          message = { ...message, server: server.href };
        }
      }
      return post.call(this, message, ...others);
    };
  })();
})();
