// The heat map.

const HEAT_CELLS = 80; // along the longer side of the field, or trees if these are fewer
const HEAT_REACH = 1.2; // squared cells

// A quantity smoothed over the field: weighted means on a grid.
function heatMap(model, quantity, transform) {
  const points = [];
  for (const survey of [model.reference, model.source]) {
    const values = survey.quantities[quantity];
    const t = survey.role === "source" ? transform : IDENTITY;
    if (values) for (let i = 0; i < survey.size; i++) points.push([...moved(t, survey.x[i], survey.y[i]), values[i]]);
  }
  const [left, right] = d3.extent(points, (point) => point[0]);
  const [bottom, top] = d3.extent(points, (point) => point[1]);
  const cell = Math.max(model.data.spacing_m, (right - left) / HEAT_CELLS, (top - bottom) / HEAT_CELLS, 0.1);
  const columns = Math.ceil((right - left) / cell) + 5;
  const rows = Math.ceil((top - bottom) / cell) + 5;
  const sum = new Float64Array(columns * rows);
  const weight = new Float64Array(columns * rows);
  for (const [x, y, value] of points) {
    const column = (x - left) / cell + 2;
    const row = (top - y) / cell + 2;
    for (let r = Math.floor(row) - 1; r <= Math.floor(row) + 2; r++) {
      for (let c = Math.floor(column) - 1; c <= Math.floor(column) + 2; c++) {
        const w = Math.exp(-((r - row) ** 2 + (c - column) ** 2) / HEAT_REACH);
        sum[r * columns + c] += w * value;
        weight[r * columns + c] += w;
      }
    }
  }
  const scale = d3.scaleSequential(rangeOf(model, quantity), d3.interpolateCividis).clamp(true);
  const canvas = Object.assign(document.createElement("canvas"), { width: columns, height: rows });
  const pixels = new ImageData(columns, rows);
  for (let k = 0; k < sum.length; k++) {
    if (weight[k] < 0.05) continue;
    const { r, g, b } = d3.rgb(scale(sum[k] / weight[k]));
    pixels.data.set([r, g, b, 255 * Math.min(1, weight[k])], 4 * k);
  }
  canvas.getContext("2d").putImageData(pixels, 0, 0);
  return { canvas, cell, left: left - 2.5 * cell, top: top + 2.5 * cell, quantity };
}

function drawHeat(ctx, view, heat) {
  const [x, y] = moved(screenFrom(view), heat.left, heat.top);
  const size = heat.cell * view.scale;
  ctx.globalAlpha = 0.8;
  ctx.imageSmoothingEnabled = true;
  ctx.drawImage(heat.canvas, x, y, heat.canvas.width * size, heat.canvas.height * size);
  ctx.globalAlpha = 1;
}
