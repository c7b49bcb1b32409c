/* Inflates zlib data (RFC 1950, 1951) synchronously: with a stream, the page might be printed before it is drawn. */
"use strict";

const ORDER = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
/** Base and extra bits of each length and distance code (RFC 1951, 3.2.5). */
const steps = (count, first, group, base) => Array.from({ length: count }, (_, k) => {
  const bits = Math.max(0, Math.floor(k / group) - first), from = base;
  base += 1 << bits;
  return [from, bits];
});
const LENGTHS = [...steps(28, 1, 4, 3), [258, 0]], DISTANCES = steps(30, 1, 2, 1);

/** Lookup table of a Huffman code by the next bits of the stream: symbol and number of bits. */
function huffman(lengths) {
  const most = Math.max(1, ...lengths), table = new Uint16Array(1 << most);
  let code = 0;
  for (let size = 1; size <= most; size++, code <<= 1) {
    lengths.forEach((own, symbol) => {
      if (own !== size) return;
      let turned = 0;
      for (let k = 0; k < size; k++) turned |= ((code >> k) & 1) << (size - 1 - k);
      for (let at = turned; at < table.length; at += 1 << size) table[at] = (symbol << 4) | size;
      code++;
    });
  }
  return { table, mask: table.length - 1 };
}

/** Inflate a zlib stream of `size` bytes. */
function inflate(bytes, size) {
  const out = new Uint8Array(size);
  let at = 2, end = 0, held = 0, count = 0, last = 0;
  const bits = (wanted) => {
    while (count < wanted) {
      held |= bytes[at++] << count;
      count += 8;
    }
    const found = held & ((1 << wanted) - 1);
    held >>>= wanted;
    count -= wanted;
    return found;
  };
  const symbol = ({ table, mask }) => {
    while (count < 15 && at < bytes.length) {
      held |= bytes[at++] << count;
      count += 8;
    }
    const found = table[held & mask], used = found & 15;
    if (!used) throw new Error("the packed numbers cannot be read");
    held >>>= used;
    count -= used;
    return found >> 4;
  };
  const codes = () => {
    const literals = bits(5) + 257, distances = bits(5) + 1, sizes = new Array(19).fill(0), lengths = [];
    for (let k = 0, all = bits(4) + 4; k < all; k++) sizes[ORDER[k]] = bits(3);
    const tree = huffman(sizes);
    while (lengths.length < literals + distances) {
      const one = symbol(tree);
      const [value, times] = one < 16 ? [one, 1] : one === 16 ? [lengths.at(-1), 3 + bits(2)] : [0, one === 17 ? 3 + bits(3) : 11 + bits(7)];
      for (let k = 0; k < times; k++) lengths.push(value);
    }
    return [huffman(lengths.slice(0, literals)), huffman(lengths.slice(literals))];
  };
  const fixed = () => [huffman(Array.from({ length: 288 }, (_, k) => (k < 144 ? 8 : k < 256 ? 9 : k < 280 ? 7 : 8))), huffman(new Array(30).fill(5))];
  while (!last) {
    last = bits(1);
    const kind = bits(2);
    if (kind === 0) {
      at -= count >> 3; // return whole bytes that were read ahead
      held = count = 0;
      const long = bytes[at] | (bytes[at + 1] << 8);
      out.set(bytes.subarray(at + 4, at + 4 + long), end);
      at += 4 + long;
      end += long;
      continue;
    }
    const [literal, distance] = kind === 1 ? fixed() : codes();
    for (let one = symbol(literal); one !== 256; one = symbol(literal)) {
      if (one < 256) {
        out[end++] = one;
        continue;
      }
      const [from, more] = LENGTHS[one - 257], long = from + bits(more), [near, farther] = DISTANCES[symbol(distance)], back = near + bits(farther);
      for (const stop = end + long; end < stop; end++) out[end] = out[end - back];
    }
  }
  if (end !== size) throw new Error(`${end} bytes of packed numbers instead of ${size}`);
  return out;
}
