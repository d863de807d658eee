// Questions to the page's own server, put again where the network drops them.
//
// A browser gives up all that is under way when an interface of its machine comes or goes; the next try succeeds.

const AGAIN_MS = [200, 1000];

// As `fetch`; rejects only when the last try has failed too.
export async function ask(url) {
  for (const pause of AGAIN_MS) {
    try {
      return await fetch(url);
    } catch {
      await new Promise((resolve) => setTimeout(resolve, pause));
    }
  }
  return fetch(url);
}
