// A number as people type it. A comma may be a decimal point; what could be read in two ways is refused.
const PLAIN = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;
const COMMA = /^[+-]?\d*,\d+(e[+-]?\d+)?$/i;
const EITHER = /^[+-]?[1-9]\d{0,2},\d{3}$/; // 1,000: a thousand, or one with three decimals
const GROUPED = /^[+-]?\d{1,3}([.,' \u00a0\u202f]\d{3})+([.,]\d+)?$/;

// { value } or { problem }, words for what it is instead; the value of an empty field is null.
export function typed(text) {
  const trimmed = text.trim().replace("\u2212", "-");
  if (trimmed === "") return { value: null };
  if (EITHER.test(trimmed)) {
    const [whole, rest] = trimmed.split(",");
    return { problem: `could mean ${whole}${rest} or ${whole}.${rest}; write the one you mean` };
  }
  const pointed = COMMA.test(trimmed) ? trimmed.replace(",", ".") : trimmed;
  if (PLAIN.test(pointed)) return { value: Number(pointed) };
  return { problem: GROUPED.test(trimmed) ? "has thousands separators; leave them out" : "is not a number" };
}

export const DIGITS = 12; // of a number as it is shown and read: a factor's rounding is beyond them

// What stands in a field: { value } in SI units, null for none, or { problem }, which says what may stand there.
export function fitted(text, { open, min, max, optional, whole, factor, allowed }) {
  const { value, problem } = typed(text);
  const least = min ?? -Infinity, most = max ?? Infinity;
  const fits = problem === undefined && (value === null ? optional
    : Number.isFinite(value) && !(value < least || value > most || (open.includes("above") && value <= least) ||
        (open.includes("below") && value >= most) || (whole && !Number.isInteger(value))));
  if (!fits) {
    const given = text.trim().slice(0, 30) || "nothing";
    return { problem: `${given}${problem ? ` ${problem}` : ""}: must be ${allowed}${whole ? ", a whole number" : ""}` };
  }
  return { value: value === null || whole ? value : Number((value * factor).toPrecision(DIGITS)) };
}

// Say beside a field what is wrong with it; nothing if all is well.
export function mark({ number, wrong }, words) {
  number.setAttribute("aria-invalid", String(Boolean(words)));
  wrong.textContent = words;
  wrong.hidden = !words;
}
