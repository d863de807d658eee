// Numbers in the element drawing: the steps of the story beside it, each at something that it talks about.

export const STEPS = ["axis", "divisions", "boundaries", "reports", "rejected", "points", "live", "waiting"];

const RADIUS_PX = 8;
const AWAY_PX = 24; // from the thing to its number

// The number of a step, as in the story.
export const numberOf = (kind) => STEPS.indexOf(kind) + 1;

// What each number points to: a place in pixels, and the side on which the number stands, as a direction.
function targets(scene, view, chosen) {
  const element = scene.elements.find((e) => e.index === chosen);
  const made = [];
  const add = (kind, at, direction) => at && made.push({ kind, at, direction });
  const left = leftOf(element, view), right = left.map((v) => -v);
  if (element) {
    const onAxis = (e, share) => (view.strip ? [view.x(e.start + share * (e.end - e.start)), view.y(0)] : view.place(middle(e.line.axis, share)));
    add("axis", onAxis(scene.elements.find((e) => e.index === chosen - 1) ?? element, 0.22), left);
    add("divisions", onAxis(element, 0), [right[0] * 0.7 - 0.7 * Math.abs(right[1]), right[1] * 0.7 + 0.7 * Math.abs(right[0])]);
    // In the strip they are at its edges, so their number stands inside.
    if (Number.isFinite(element.halfWidth)) {
      const place = view.strip ? [view.x(element.start + 0.8 * (element.end - element.start)), view.y(element.halfWidth)] : view.place(middle(element.boundaries[0], 0.8));
      add("boundaries", place, view.strip ? right : left);
    }
    const report = element.reports.filter((r) => r.accepted).reduce((most, r) => (!most || Math.abs(r.across) > Math.abs(most.across) ? r : most), null);
    if (report) add("reports", view.of(report), view.strip ? [0.7, report.across > 0 ? 0.7 : -0.7] : report.across > 0 ? left : right);
    if (element.point) add("points", view.of(element.point), right);
  }
  const refused = scene.elements.flatMap((e) => e.reports.filter((r) => !r.accepted)).at(-1);
  if (refused) add("rejected", view.of(refused), [0.7, 0.7]);
  if (scene.live) add("live", view.of(scene.live), left);
  if (scene.waiting.length) add("waiting", view.of(scene.waiting[0]), right);
  return made;
}

// The direction to the left of the flight on the screen.
function leftOf(element, view) {
  if (view.strip || !element) return [0, -1];
  const [x1, y1] = view.place(element.line.axis[0]), [x2, y2] = view.place(element.line.axis.at(-1));
  const length = Math.hypot(x2 - x1, y2 - y1) || 1;
  return [(y2 - y1) / length, -(x2 - x1) / length];
}

function middle(line, share) {
  const at = share * (line.length - 1), k = Math.min(Math.floor(at), line.length - 2);
  return [0, 1].map((i) => line[k][i] + (at - k) * (line[k + 1][i] - line[k][i]));
}

// Draw them; returns how many.
export function drawBadges(context, scene, view, chosen, colours, faint) {
  let drawn = 0;
  context.font = "600 11px system-ui, sans-serif";
  context.textAlign = "center";
  for (const { kind, at: [x, y], direction: [u, v] } of targets(scene, view, chosen)) {
    if (x < view.box.left - 4 || x > view.box.right + 4 || y < 0 || y > view.height) continue;
    const bx = x + u * AWAY_PX, by = Math.max(RADIUS_PX + 1, Math.min(view.height - RADIUS_PX - 1, y + v * AWAY_PX));
    faint(kind);
    context.strokeStyle = colours.faint;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(x + u * 6, y + v * 6);
    context.lineTo(bx, by);
    context.stroke();
    context.beginPath();
    context.arc(bx, by, RADIUS_PX, 0, 2 * Math.PI);
    context.fillStyle = colours.panel;
    context.fill();
    context.stroke();
    context.fillStyle = colours.text;
    context.fillText(String(numberOf(kind)), bx, by + 4);
    drawn += 1;
  }
  context.textAlign = "left";
  context.globalAlpha = 1;
  return drawn;
}
