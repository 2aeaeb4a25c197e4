// The networks that come with npend_gym: tanh layers from observations to the action.

/** Weights as the generator packed them: rows of whole numbers, a factor for each row. */
class Policy {
  /** Read layers of `shapes` from `bytes`, from `place` on; `end` is the place after them. */
  constructor({ n, shapes, scale, output }, bytes, place) {
    const floats = (count) => {
      place += 4 * count;
      return new Float32Array(bytes.slice(place - 4 * count, place).buffer);
    };
    Object.assign(this, { n, scale, output });
    this.layers = shapes.map(([outputs, inputs]) => {
      const biases = floats(outputs), factors = floats(outputs), size = outputs * inputs;
      const high = new Int8Array(bytes.buffer, bytes.byteOffset + place, size);
      const low = bytes.subarray(place + size); // two bits of each weight, four weights in a byte
      place += size + Math.ceil(size / 4);
      const weights = Float32Array.from(high, (value, k) => {
        const whole = 4 * value + ((low[k >> 2] >> (2 * (k & 3))) & 3);
        return whole * factors[Math.floor(k / inputs)];
      });
      return { weights, biases };
    });
    this.end = place;
  }

  /** Torque over its limit, -1 to 1, for an observation. */
  act(observation) {
    let signal = Array.from(observation, (value, k) => value / this.scale[k]);
    this.layers.forEach(({ weights, biases }, layer) => {
      const last = layer === this.layers.length - 1, inputs = signal.length;
      signal = Array.from(biases, (bias, row) => {
        let sum = bias;
        for (let k = 0; k < inputs; k++) sum += weights[row * inputs + k] * signal[k];
        return last ? sum : Math.tanh(sum);
      });
    });
    return this.output === "tanh" ? Math.tanh(signal[0]) : Math.max(-1, Math.min(1, signal[0]));
  }
}

/** Unpack what the page carries: text to bytes, and what was compressed. */
async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
