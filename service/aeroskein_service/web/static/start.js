// Loads the page again when one of its own files could not be had: the server was just starting, or the network changed.
// A plain script, ahead of everything, for a module that fails takes all others with it.

addEventListener("error", (event) => {
  const { target } = event;
  if (target instanceof HTMLScriptElement || target.rel === "stylesheet") setTimeout(() => location.reload(), 2000);
}, true);
