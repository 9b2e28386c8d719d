/** Where a number lies on a scale of three equal parts: good, fair, bad. Pure. */
export function markerShare(value: number, good: number, fair: number): number {
  if (value <= good) return value / good / 3;
  if (value <= fair) return (1 + (value - good) / (fair - good)) / 3;
  // Beyond fair it nears the end and never reaches it.
  return (3 - fair / value) / 3;
}
