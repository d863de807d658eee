// The texts of the page whose contrast with what is really behind them is below 4.5:1, that of WCAG AA.
(() => {
  const parse = (text) => {
    const v = text.match(/[\d.]+/g).map(Number);
    const alpha = v[3] ?? 1;
    return text.startsWith("color(") ? [v[0] * 255, v[1] * 255, v[2] * 255, alpha] : [v[0], v[1], v[2], alpha];
  };
  const linear = (c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4);
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const over = (top, ground) => [0, 1, 2].map((k) => top[k] * top[3] + ground[k] * (1 - top[3]));
  const behind = (element) => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) {
      layers.push(parse(getComputedStyle(e).backgroundColor));
      if (layers.at(-1)[3] === 1) break;
    }
    return layers.reduceRight((ground, layer) => over(layer, ground), [255, 255, 255]);
  };
  const low = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim(), element = walker.currentNode.parentElement;
    if (!text || !element.offsetParent || element.closest("noscript, script, .spoken, option")) continue;
    const ground = behind(element);
    const a = luminance(over(parse(getComputedStyle(element).color), ground)), b = luminance(ground);
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) low.push(`${text.slice(0, 30)} ${ratio.toFixed(2)}`);
  }
  return low;
})()
