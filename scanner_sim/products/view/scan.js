"use strict";
// The page of a raster or of a table of shots.

/** Return the picture of a raster, each voxel a dot, and what redraws it; a click calls `choose` with a voxel. */
function rasterMap(data, cloud, choose) {
  const [rows, columns] = data.shape;
  const canvas = el("canvas", { className: "map", id: "map", width: columns, height: rows, title: "The raster: click at a voxel" });
  const context = canvas.getContext("2d");
  canvas.addEventListener("click", (event) => {
    const box = canvas.getBoundingClientRect();
    const scale = Math.min(box.width / columns, box.height / rows);
    const column = Math.floor((event.clientX - box.left - 0.5 * (box.width - scale * columns)) / scale);
    const row = Math.floor((event.clientY - box.top - 0.5 * (box.height - scale * rows)) / scale);
    if (row >= 0 && row < rows && column >= 0 && column < columns) choose(row * columns + column);
  });
  return {
    canvas,
    draw(chosen) {
      const dots = new ImageData(columns, rows);
      dots.data.set(cloud.colours);
      for (let i = 3; i < dots.data.length; i += 4) dots.data[i] = 255;
      context.putImageData(dots, 0, 0);
      if (chosen < 0) return;
      context.strokeStyle = colourOf("--warm");
      context.lineWidth = Math.max(1, columns / 200);
      const [row, column, away] = [Math.floor(chosen / columns) + 0.5, (chosen % columns) + 0.5, Math.max(3, columns / 50)];
      context.strokeRect(column - away, row - away, 2 * away, 2 * away);
    },
  };
}

async function showScan() {
  const data = await unpackAll(DATA);
  byId("about").textContent = data.about;
  const space = new Space(byId("space")), shading = new Shading(data), signals = new Signals(data);
  const isShown = (i) => data.layers.status[i] === VALID;
  space.surround(data.position, isShown);
  const [rows, columns] = [data.shape[0], data.shape[1] ?? data.shape[0]];
  const wide = Math.abs(data.theta[data.raster ? columns - 1 : 0] - data.theta[0]), tall = Math.abs(data.phi[data.phi.length - 1] - data.phi[0]);
  const pitch = data.raster ? Math.max(wide / Math.max(columns - 1, 1), tall / Math.max(rows - 1, 1)) : 0.3 / Math.sqrt(data.shape[0]);
  const cloud = space.addPoints(data.position, 1.15 * pitch);
  let chosen = -1;
  const marker = space.addLines(new Float32Array(18), "--warm");
  marker.visible = false;
  const map = data.raster ? rasterMap(data, cloud, (i) => choose(i)) : null;
  const keys = [...VIEW_KEYS, ["← → ↑ ↓", "the voxel beside"], ["c", "next colouring"], ["i", "voxels without a range"], ["f", "field of view"]];
  const about = el("div", {}, el("p", { className: "aside" }, "Click at a point to see its numbers and its line."));
  byId("panel").append(...(map ? [map.canvas] : []), about, ...foot(keys));

  function recolour() {
    shading.fill(cloud.colours, data.position);
    space.changed(cloud);
    map?.draw(chosen);
  }

  function choose(i) {
    if (i < 0 || i >= shading.count) return;
    chosen = i;
    about.replaceChildren(...voxelPart(data, signals, i));
    const at = data.position.subarray(3 * i, 3 * i + 3);
    marker.visible = Number.isFinite(at[0]);
    if (marker.visible) space.move(marker, cross(at, 0.03 * space.extent));
    map?.draw(chosen);
    space.draw();
    history.replaceState(null, "", data.raster ? `#voxel=${Math.floor(i / columns) * data.step},${(i % columns) * data.step}` : `#shot=${i * data.step}`);
  }

  const frame = drawSurroundings(space, data.surroundings);
  const controls = tools(shading, cloud, frame, recolour);
  views(space, (letter) => {
    const beside = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: data.raster ? -columns : -1, ArrowDown: data.raster ? columns : 1 };
    if (letter in beside) choose(chosen < 0 ? Math.floor(shading.count / 2) : chosen + beside[letter]);
    else if (letter === "c") controls.next();
    else if (letter === "i") controls.toggleInvalid();
    else if (letter === "f") controls.toggleFrame();
    else return false;
    return true;
  });
  watchPointer(space, cloud, choose, (i) => tipOf(data, i));
  space.theme();
  space.look("all");
  const wanted = new URLSearchParams(location.hash.slice(1));
  const place = (wanted.get("voxel") ?? "").split(",").map(Number);
  if (data.raster && place.length === 2) choose(Math.floor(place[0] / data.step) * columns + Math.floor(place[1] / data.step));
  else if (wanted.has("shot")) choose(Math.floor(Number(wanted.get("shot")) / data.step));
  if (wanted.has("colour")) controls.pick(Math.max(0, data.shades.findIndex((one) => one.name === wanted.get("colour"))));
  if (wanted.has("view")) space.look(wanted.get("view"));
  document.documentElement.dataset.state = "ready";
  return { space, shading, cloud, choose, data };
}

const page = showScan();
