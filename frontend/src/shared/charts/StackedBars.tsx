import type { ReactElement } from "react";
import { count } from "../format";
import { Fitted } from "./Fitted";
import { apart, ticks } from "./scale";

export type Stack = { key: string; label: string; parts: readonly { tone: string; value: number }[]; title: string };

const LEFT = 38;
const BOTTOM = 22;

type Properties = { bars: readonly Stack[]; summary: string; every: number; height?: number };

/** Bars whose parts stand on one another, with a round axis; each bar says its figures in its `title`. */
export function StackedBars({ height = 160, ...properties }: Properties): ReactElement {
  return <Fitted>{(width) => <Bars {...properties} height={height} width={width} />}</Fitted>;
}

function Bars({ bars, summary, every, width, height }: Required<Properties> & { width: number }): ReactElement {
  const most = Math.max(1, ...bars.map(({ parts }) => parts.reduce((sum, { value }) => sum + value, 0)));
  const axis = ticks(most);
  const top = axis.at(-1) ?? 1;
  const y = (value: number): number => 8 + (height - BOTTOM - 8) * (1 - value / top);
  const step = (width - LEFT) / Math.max(1, bars.length);
  const gap = step > 12 ? 3 : step > 4 ? 1 : 0;
  const labelled = apart(every, step, Math.max(0, ...bars.map(({ label }) => label.length)));
  return (
    <svg className="chart num" viewBox={`0 0 ${width} ${height}`} role="img" aria-label={summary}>
      {axis.map((at) => (
        <g key={at}>
          <path d={`M${LEFT} ${y(at)}H${width}`} stroke="var(--line)" />
          <text x={LEFT - 6} y={y(at) + 4} textAnchor="end">
            {count(at)}
          </text>
        </g>
      ))}
      {bars.map((bar, i) => {
        let below = 0;
        return (
          <g key={bar.key}>
            <title>{bar.title}</title>
            {/* A low bar is hard to hit with the pointer: its whole column tells. */}
            <rect x={LEFT + i * step} y={8} width={step} height={height - BOTTOM - 8} fill="transparent" />
            {bar.parts.map(({ tone, value }) => {
              const from = y(below);
              below += value;
              return value === 0 ? null : (
                <rect key={tone} x={LEFT + i * step + gap / 2} width={Math.max(1, step - gap)} y={y(below)} height={from - y(below)} fill={`var(--${tone})`} />
              );
            })}
            {i % labelled === 0 && (
              <text x={LEFT + i * step + step / 2} y={height - 6} textAnchor="middle">
                {bar.label}
              </text>
            )}
          </g>
        );
      })}
    </svg>
  );
}
