// Names with their verbs, and numbers as they are shown.

/**
 * @typedef {object} Who somebody that flies
 * @property {string} name of the policy
 * @property {string} title as in a table: `DDQN agent`
 * @property {string} subject as in a sentence: `the DDQN agent`
 * @property {boolean} you whether it is the reader, whose verbs have no s
 */

/** A verb in the person of its subject: `who("crashes")` or, of the reader, `you crash`. */
export const says = ({ subject, you }, verb, rest = "") =>
  `${subject} ${you ? verb.replace(/(?<=sh)es$|s$/, "") : verb}${rest && ` ${rest}`}`;
export const upper = (text) => text.slice(0, 1).toUpperCase() + text.slice(1);
export const units = (amount) =>
  amount >= 0.1 || amount === 0 ? amount.toFixed(1) : amount.toPrecision(1);
export const signed = (value) => (value <= -0.05 ? "−" : "") + Math.abs(value).toFixed(1);
export const grouped = (number) => number.toLocaleString("en");
export const LONGEST = 500; // units of time that a mission of this page has at most
export const counted = (count, what) => `${count} ${what}${count === 1 ? "" : "s"}`;
export const timeUnits = (count) => `${counted(count, "unit")} of time`;
export const listed = (all, and = "and") =>
  all.length > 1 ? `${all.slice(0, -1).join(", ")} ${and} ${all.at(-1)}` : all[0];
