// The elements of the selected aircraft on the map itself, where they are: for those who have zoomed in far enough.

import { ellipse, ellipseOutline } from "./elements_data.js";
import { LocalPlane } from "./projection.js";

const FAR_ZOOM = 9; // from here on an element is some pixels long
const DIVISIONS_ZOOM = 11; // closer than this their marks do not touch
const DETAIL_ZOOM = 12;

export class ElementsOnMap {
  constructor(sensorColour) {
    this._sensorColour = sensorColour;
    this.drawn = 0;
  }

  draw(context, view, colours, history) {
    this.drawn = 0;
    if (view.zoom < FAR_ZOOM) return;
    const trace = (places) => {
      context.beginPath();
      places.forEach(([lat, lon], k) => {
        const [x, y] = view.toScreen(lat, lon);
        if (k) context.lineTo(x, y);
        else context.moveTo(x, y);
      });
      context.stroke();
    };
    for (const element of history.list().slice(-30)) {
      this.drawn += 1;
      context.lineWidth = 1.8;
      context.strokeStyle = element.point?.master ? this._sensorColour(element.point.master) : colours.axis;
      if (element.axis) trace(element.axis);
      context.lineWidth = 1;
      context.strokeStyle = colours.boundary;
      context.setLineDash([6, 4]);
      for (const side of element.boundary_lines ?? []) trace(side);
      context.setLineDash([]);
      context.fillStyle = colours.division;
      for (const [lat, lon] of view.zoom >= DIVISIONS_ZOOM ? element.division_points ?? [] : []) {
        const [x, y] = view.toScreen(lat, lon);
        context.fillRect(x - 3, y - 3, 6, 6);
      }
      if (view.zoom >= DETAIL_ZOOM) this._details(context, view, colours, element);
    }
  }

  _details(context, view, colours, element) {
    for (const report of element.reports ?? []) {
      const [x, y] = view.toScreen(report.lat_deg, report.lon_deg);
      context.fillStyle = context.strokeStyle = this._sensorColour(report.sensor);
      context.beginPath();
      context.arc(x, y, 3, 0, 2 * Math.PI);
      if (report.accepted) context.fill();
      else context.stroke();
    }
    const point = element.point;
    const shape = point ? ellipse(point.position_cov_m2, [1, 0]) : null;
    if (!shape) return;
    const plane = new LocalPlane(point.lat_deg, point.lon_deg);
    context.strokeStyle = colours.ellipse;
    context.lineWidth = 1.4;
    context.beginPath();
    for (const [east, north] of ellipseOutline(shape, "plan", 1)) {
      const [x, y] = view.toScreen(point.lat_deg + north / plane.north, point.lon_deg + east / plane.east);
      context.lineTo(x, y);
    }
    context.stroke();
  }
}
