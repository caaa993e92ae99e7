// A Q-network that learns: network.py with its gradients, and the optimiser. tests/labs/test_learning.py
// compares both with PyTorch's. A batch has n rows, and each layer its own buffers for as many as it has
// at most: `forward(x, n)` gives the layer's output, `backward(slopes, n)` the gradients of its weights
// and, from the slopes of what comes out, those of what goes in.

import { ACTIONS } from "./world.js";

/** Weights of a layer, under their name in PyTorch, with their gradient and what Adam keeps of it. */
class Weights {
  constructor(name, shape, values) {
    Object.assign(this, { name, shape, values });
    for (const part of ["gradient", "moment", "square", "largest"])
      this[part] = new Float32Array(values.length);
  }
}

/**
 * c = a · bᵀ, of which a has `rows` and b `cols` rows of `inner` numbers. Two rows by four are summed
 * at once, so that what is read serves several sums; where rows end, the last one comes again. Each
 * sum is a variable of its own, because engines make fast code of that alone.
 */
function product(a, b, c, rows, cols, inner) {
  for (let j = 0; j < cols; j += 4) {
    const [j1, j2, j3] = [
      Math.min(j + 1, cols - 1),
      Math.min(j + 2, cols - 1),
      Math.min(j + 3, cols - 1),
    ];
    const p = j * inner;
    const q = j1 * inner;
    const r = j2 * inner;
    const s = j3 * inner;
    for (let i = 0; i < rows; i += 2) {
      const below = Math.min(i + 1, rows - 1);
      const first = i * inner;
      const second = below * inner;
      let s0 = 0;
      let s1 = 0;
      let s2 = 0;
      let s3 = 0;
      let t0 = 0;
      let t1 = 0;
      let t2 = 0;
      let t3 = 0;
      for (let k = 0; k < inner; k++) {
        const x = a[first + k];
        const y = a[second + k];
        const w0 = b[p + k];
        const w1 = b[q + k];
        const w2 = b[r + k];
        const w3 = b[s + k];
        s0 += x * w0;
        t0 += y * w0;
        s1 += x * w1;
        t1 += y * w1;
        s2 += x * w2;
        t2 += y * w2;
        s3 += x * w3;
        t3 += y * w3;
      }
      const above = i * cols;
      const under = below * cols;
      c[above + j] = s0;
      c[above + j1] = s1;
      c[above + j2] = s2;
      c[above + j3] = s3;
      c[under + j] = t0;
      c[under + j1] = t1;
      c[under + j2] = t2;
      c[under + j3] = t3;
    }
  }
}

/** b = aᵀ, of which a has so many rows and columns. */
function transpose(a, b, rows, cols) {
  for (let i = 0; i < rows; i++) for (let j = 0; j < cols; j++) b[j * rows + i] = a[i * cols + j];
}

/** Fully connected; the first weights are Glorot's uniform ones. */
class Linear {
  constructor(
    name,
    inputs,
    outputs,
    batch,
    generator,
    fan = [inputs, outputs],
    shape = [outputs, inputs],
  ) {
    Object.assign(this, { inputs, outputs });
    const most = Math.sqrt(6 / (fan[0] + fan[1]));
    const values = new Float32Array(inputs * outputs).map(() => generator.uniform(-most, most));
    this.weight = new Weights(`${name}.weight`, shape, values);
    this.bias = new Weights(`${name}.bias`, [outputs], new Float32Array(outputs));
    this.weights = [this.weight, this.bias];
    const sizes = { out: batch * outputs, slopes: batch * inputs, columns: inputs * batch };
    Object.assign(sizes, { turned: outputs * batch, across: inputs * outputs });
    for (const [buffer, size] of Object.entries(sizes)) this[buffer] = new Float32Array(size);
  }

  forward(x, n) {
    const { inputs, outputs, out, bias } = this;
    product(x, this.weight.values, out, n, outputs, inputs);
    for (let at = 0; at < n * outputs; at++) out[at] += bias.values[at % outputs];
    this.x = x;
    return out;
  }

  backward(slopes, n) {
    const { inputs, outputs, columns, turned, across, weight } = this;
    transpose(this.x, columns, n, inputs);
    transpose(slopes, turned, n, outputs);
    transpose(weight.values, across, outputs, inputs);
    product(turned, columns, weight.gradient, outputs, inputs, n);
    const bias = this.bias.gradient.fill(0);
    for (let at = 0; at < n * outputs; at++) bias[at % outputs] += slopes[at];
    if (this.first) return null; // nothing is before it
    product(slopes, across, this.slopes, n, inputs, outputs);
    return this.slopes;
  }
}

/** Puts into each row of a batch what stands at some places of the row before, and more behind it. */
class Gather {
  weights = [];

  constructor(places, length, batch, more = 0) {
    Object.assign(this, { places: Int32Array.from(places), length, more, extra: null });
    this.width = places.length + more;
    this.out = new Float32Array(batch * this.width);
    this.slopes = new Float32Array(batch * length);
  }

  forward(x, n) {
    const { places, length, width, out } = this;
    for (let row = 0; row < n; row++) {
      for (let k = 0; k < places.length; k++) out[row * width + k] = x[row * length + places[k]];
      if (this.more) out[row * width + places.length] = this.extra[row];
    }
    return out;
  }

  backward(slopes, n) {
    const { places, length, width } = this;
    this.slopes.fill(0);
    for (let row = 0; row < n; row++)
      for (let k = 0; k < places.length; k++)
        this.slopes[row * length + places[k]] += slopes[row * width + k];
    return this.slopes;
  }
}

/** Kernels over each place of a map, no padding: for each place, what is under the kernel, fully connected. */
class Convolution {
  /** @param {(channel: number, cell: number) => number} at where the map has it */
  constructor(name, channels, width, { kernels, kernel_size: side }, stride, batch, generator, at) {
    this.width = Math.floor((width - side) / stride) + 1;
    this.places = this.width ** 2;
    const under = [];
    for (let place = 0; place < this.places; place++) {
      const corner =
        Math.floor(place / this.width) * stride * width + (place % this.width) * stride;
      for (let channel = 0; channel < channels; channel++)
        for (let tap = 0; tap < side ** 2; tap++)
          under.push(at(channel, corner + Math.floor(tap / side) * width + (tap % side)));
    }
    const [area, rows] = [side ** 2, batch * this.places];
    this.gather = new Gather(under, channels * width ** 2, batch);
    const fan = [channels * area, kernels * area];
    const shape = [kernels, channels, side, side];
    this.linear = new Linear(name, channels * area, kernels, rows, generator, fan, shape);
    this.weights = this.linear.weights;
  }

  forward(x, n) {
    return this.linear.forward(this.gather.forward(x, n), n * this.places);
  }

  backward(slopes, n) {
    const before = this.linear.backward(slopes, n * this.places);
    return before && this.gather.backward(before, n);
  }
}

class LayerNorm {
  constructor(name, units, batch) {
    this.units = units;
    this.weight = new Weights(`${name}.weight`, [units], new Float32Array(units).fill(1));
    this.bias = new Weights(`${name}.bias`, [units], new Float32Array(units));
    this.weights = [this.weight, this.bias];
    for (const buffer of ["out", "normal", "slopes"])
      this[buffer] = new Float32Array(batch * units);
    this.scale = new Float32Array(batch);
  }

  forward(x, n) {
    const { units, out, normal, scale, weight, bias } = this;
    for (let row = 0; row < n; row++) {
      const there = row * units;
      let [mean, variance] = [0, 0];
      for (let k = 0; k < units; k++) mean += x[there + k] / units;
      for (let k = 0; k < units; k++) variance += (x[there + k] - mean) ** 2 / units;
      scale[row] = 1 / Math.sqrt(variance + 1e-5);
      for (let k = 0; k < units; k++) {
        normal[there + k] = (x[there + k] - mean) * scale[row];
        out[there + k] = normal[there + k] * weight.values[k] + bias.values[k];
      }
    }
    return out;
  }

  backward(slopes, n) {
    const { units, normal, scale, weight } = this;
    const [gradient, bias] = [weight.gradient.fill(0), this.bias.gradient.fill(0)];
    for (let row = 0; row < n; row++) {
      const there = row * units;
      let [mean, along] = [0, 0];
      for (let k = 0; k < units; k++) {
        const [slope, own] = [slopes[there + k], normal[there + k]];
        bias[k] += slope;
        gradient[k] += slope * own;
        mean += (slope * weight.values[k]) / units;
        along += (slope * weight.values[k] * own) / units;
      }
      for (let k = 0; k < units; k++) {
        const slope = slopes[there + k] * weight.values[k];
        this.slopes[there + k] = scale[row] * (slope - mean - normal[there + k] * along);
      }
    }
    return this.slopes;
  }
}

/** Makes what is negative 0, in place. */
class Relu {
  weights = [];

  forward(x) {
    for (let at = 0; at < x.length; at++) if (x[at] < 0) x[at] = 0;
    this.x = x;
    return x;
  }

  backward(slopes) {
    for (let at = 0; at < slopes.length; at++) if (this.x[at] === 0) slopes[at] = 0;
    return slopes;
  }
}

/** Q-values of all actions; see network.py. */
export class QNetwork {
  /**
   * @param {object} recipe its layers
   * @param {number} channels of the map
   * @param {number} side of the map, cells
   * @param {number} batch the most rows at a time
   * @param {import("./world.js").Portable} generator of the first weights
   */
  constructor(recipe, channels, side, batch, generator) {
    const { kernels, strides, hidden, layer_norm } = recipe;
    const layers = (this.layers = []);
    let [width, before] = [side, channels];
    strides.forEach((stride, k) => {
      const cells = width ** 2;
      const at = (channel, cell) => (k ? cell * kernels + channel : channel * cells + cell);
      const name = `convolutions.${2 * k}`;
      const layer = new Convolution(name, before, width, recipe, stride, batch, generator, at);
      layers.push(layer, new Relu());
      [width, before] = [layer.width, kernels];
    });
    layers[0].linear.first = true;
    const places = width ** 2; // a kernel's places follow one another, then comes the flying time
    const turned = Array.from(
      { length: kernels * places },
      (_, k) => (k % places) * kernels + Math.floor(k / places),
    );
    layers.push((this.flat = new Gather(turned, turned.length, batch, 1)));
    let [inputs, number] = [turned.length + 1, 0];
    for (const units of hidden) {
      layers.push(new Linear(`head.${number++}`, inputs, units, batch, generator));
      if (layer_norm) layers.push(new LayerNorm(`head.${number++}`, units, batch));
      layers.push(new Relu());
      [inputs, number] = [units, number + 1];
    }
    layers.push(new Linear(`head.${number}`, inputs, ACTIONS.length, batch, generator));
    this.weights = layers.flatMap((layer) => layer.weights);
    this.steps = 0; // of Adam
  }

  /**
   * @param {Float32Array} maps (n, channels, side, side)  @param {Float32Array} times (n,)
   * @returns {Float32Array} (n, 6), the same array each time
   */
  forward(maps, times, n) {
    this.flat.extra = times;
    return this.layers.reduce((x, layer) => layer.forward(x, n), maps);
  }

  /** The gradients of what has these slopes in the last Q-values. @param {Float32Array} slopes (n, 6) */
  backward(slopes, n) {
    this.layers.reduceRight((x, layer) => layer.backward(x, n), slopes);
  }

  /** A step of Adam down the gradients, with the recipe's ε of 1e-7. */
  descend(rate, amsgrad) {
    this.steps += 1;
    const step = rate / (1 - 0.9 ** this.steps);
    const unbiased = 1 / Math.sqrt(1 - 0.999 ** this.steps);
    for (const { values, gradient, moment, square, largest } of this.weights) {
      for (let k = 0; k < values.length; k++) {
        const slope = gradient[k];
        moment[k] += 0.1 * (slope - moment[k]);
        square[k] += 0.001 * (slope * slope - square[k]);
        if (square[k] > largest[k]) largest[k] = square[k];
        const size = amsgrad ? largest[k] : square[k];
        values[k] -= (step * moment[k]) / (Math.sqrt(size) * unbiased + 1e-7);
      }
    }
  }

  /** θ ← (1 − τ) θ + τ θ of the other; a τ of 1 copies it. */
  follow(other, tau) {
    this.weights.forEach(({ values }, number) => {
      const goals = other.weights[number].values;
      for (let k = 0; k < values.length; k++) values[k] += tau * (goals[k] - values[k]);
    });
  }

  /** By name, as in a checkpoint. @returns {Object<string, {shape: number[], values: Float32Array}>} */
  get tensors() {
    return Object.fromEntries(this.weights.map(({ name, ...tensor }) => [name, tensor]));
  }

  set tensors(tensors) {
    for (const { name, values } of this.weights) values.set(tensors[name].values);
  }
}
