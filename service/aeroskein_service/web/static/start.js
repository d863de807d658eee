// Loads the page again when one of its own files could not be had: the server was just starting, or the network changed.
// A plain script, ahead of everything, for a module that fails takes all others with it.

addEventListener("error", (event) => {
  if (event.target instanceof HTMLScriptElement || event.target instanceof HTMLLinkElement) setTimeout(() => location.reload(), 2000);
}, { capture: true, once: true });
