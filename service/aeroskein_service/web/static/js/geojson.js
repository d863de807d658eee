// The user's own layers: GeoJSON with airspace, routes, fixes, from the server's configuration or dropped onto the page.
//
// A dropped file stays in this browser. Unknown kinds of geometry are skipped; a file that is no GeoJSON is refused.

import { mercatorX, mercatorY } from "./projection.js";

const LABEL_ZOOM = 6;

// A layer `{name, lines, points}` in Mercator units. Raises an Error for anything that is no GeoJSON.
export function readLayer(name, content) {
  const layer = { name, shown: true, lines: [], points: [] };
  const features = content?.type === "FeatureCollection" ? content.features : content?.type === "Feature" ? [content] : [{ geometry: content }];
  if (!Array.isArray(features)) throw new Error(`${name} is no GeoJSON`);
  for (const feature of features) {
    const properties = feature?.properties ?? {};
    const title = properties.name ?? properties.title ?? properties.id ?? "";
    addGeometry(layer, feature?.geometry, String(title));
  }
  if (layer.lines.length + layer.points.length === 0) throw new Error(`${name} has no places in it`);
  return layer;
}

function addGeometry(layer, geometry, title) {
  if (!geometry) return;
  const { type, coordinates } = geometry;
  if (type === "GeometryCollection") (geometry.geometries ?? []).forEach((g) => addGeometry(layer, g, title));
  else if (type === "Point") addPoint(layer, coordinates, title);
  else if (type === "MultiPoint") coordinates.forEach((c) => addPoint(layer, c, title));
  else if (type === "LineString") addLine(layer, coordinates, title);
  else if (type === "MultiLineString" || type === "Polygon") coordinates.forEach((c) => addLine(layer, c, title));
  else if (type === "MultiPolygon") coordinates.forEach((p) => p.forEach((c) => addLine(layer, c, title)));
}

function place(c) {
  const [lon, lat] = c;
  return Number.isFinite(lon) && Number.isFinite(lat) ? [mercatorX(lon), mercatorY(lat)] : null;
}

function addPoint(layer, c, title) {
  const at = place(c);
  if (at) layer.points.push({ x: at[0], y: at[1], title });
}

function addLine(layer, coordinates, title) {
  const points = coordinates.map(place).filter(Boolean);
  if (points.length > 1) layer.lines.push({ points, title });
}

export function drawUserLayers(context, view, layers, colours) {
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  layers.filter((layer) => layer.shown).forEach((layer) => {
    context.strokeStyle = context.fillStyle = colours.layer;
    context.beginPath();
    for (const { points } of layer.lines) {
      let before = 0;
      points.forEach(([x, y], k) => {
        const sx = view.screenX(x), sy = view.screenY(y);
        if (k > 0 && Math.abs(sx - before) < view.scale / 2) context.lineTo(sx, sy);
        else context.moveTo(sx, sy);
        before = sx;
      });
    }
    context.stroke();
    for (const point of layer.points) {
      const sx = view.screenX(point.x), sy = view.screenY(point.y);
      context.fillRect(sx - 2, sy - 2, 4, 4);
      if (view.zoom > LABEL_ZOOM && point.title) context.fillText(point.title, sx + 5, sy + 4);
    }
    if (view.zoom > LABEL_ZOOM) {
      for (const { points, title } of layer.lines) {
        if (title) context.fillText(title, view.screenX(points[0][0]) + 4, view.screenY(points[0][1]) - 4);
      }
    }
  });
}
