// The road as vehicles drove it: a picture of its own, drawn again only when the view has changed, or for new segments.

const AGAIN_MS = 500;
const WIDEST_PX = 24;

export class DrivenRoad {
  #canvas = document.createElement("canvas");
  #pen = this.#canvas.getContext("2d");
  #seen = "";
  #drawnMs = -AGAIN_MS;

  /** Draws the paths of a site, or of all, onto `pen`. */
  draw(pen, view, paths, site, colour, ms) {
    const { east, north, scale, angle, rows, width, height } = view;
    if (!(width && height)) return;
    const seen = [site, colour, east, north, scale, angle, rows, width, height].join(" ");
    if (seen !== this.#seen || ms - this.#drawnMs > AGAIN_MS) {
      this.#draw(view, paths.of(site), colour);
      this.#seen = seen;
      this.#drawnMs = ms;
    }
    pen.drawImage(this.#canvas, 0, 0, width, height);
  }

  #draw(view, segments, colour) {
    const pen = this.#pen, { width, height } = view;
    this.#canvas.width = width * devicePixelRatio; // this clears it
    this.#canvas.height = height * devicePixelRatio;
    pen.scale(devicePixelRatio, devicePixelRatio);
    pen.beginPath();
    for (const [, e0, n0, e1, n1] of segments) {
      const [x0, y0, row0] = view.at(e0, n0), [x1, y1, row1] = view.at(e1, n1);
      if (row0 !== row1 || isOutside(x0, x1, width) || isOutside(y0, y1, height)) continue;
      pen.moveTo(x0, y0);
      pen.lineTo(x1, y1);
    }
    pen.strokeStyle = colour;
    pen.lineWidth = Math.min(Math.max(view.scale * 3.5, 2), WIDEST_PX);
    pen.lineCap = "round";
    pen.stroke();
  }
}

const isOutside = (a, b, size) => Math.max(a, b) < -WIDEST_PX || Math.min(a, b) > size + WIDEST_PX;
