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
