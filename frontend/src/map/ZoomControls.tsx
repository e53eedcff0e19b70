import type { ReactElement } from "react";
import { hasBuildings, useBaseMap } from "./baseMap";
import { useMapWishes, wishMap } from "./mapWishes";
import { mapTexts as t } from "./texts";

type Properties = {
  /** The table stands in the map's place: nothing to zoom or measure. */
  table?: boolean;
  measuring?: boolean;
  /** Missing where there is none: in the past. */
  networked?: boolean;
  onZoom: (levels: number) => void;
  onAll: () => void;
  onMeasure?: () => void;
  /** What `onAll` shows, where that is not all pads. */
  all?: string;
  onNetworked?: () => void;
  onTable?: () => void;
  onWall?: () => void;
  /** Whether the place is looked at aslant; missing where that is not offered. */
  deep?: boolean | undefined;
  /** Where the camera looks, degrees clockwise from north. */
  bearing?: number;
  onDeep?: () => void;
  onNorth?: () => void;
};

type Tool = { name: string; key: string; path: string; pressed?: boolean; stays?: true; turned?: number; act: () => void };

function tools({ table = false, measuring = false, all = t("allPads"), networked, onZoom, onAll, onMeasure, onNetworked, onTable, onWall, deep, bearing = 0, onDeep, onNorth }: Properties, imagery: boolean | undefined): Tool[] {
  const map: Tool[] = [
    { name: t("closer"), key: "+", path: "M10 4v12M4 10h12", act: () => onZoom(1) },
    { name: t("further"), key: "−", path: "M4 10h12", act: () => onZoom(-1) },
    { name: all, key: "0", path: "M3 7V3h4M13 3h4v4M17 13v4h-4M7 17H3v-4", stays: true, act: onAll },
    ...(deep === undefined || onDeep === undefined
      ? []
      : [{ name: t(deep ? "flat" : "deep"), key: "3", path: deep ? "M4 4h12v12H4zM4 10h12M10 4v12" : "M10 2.5l7 3.6v7.8l-7 3.6-7-3.6V6.1zM3 6.1l7 3.6 7-3.6M10 9.7v7.8", act: onDeep }]),
    ...(onNorth === undefined || Math.abs(bearing) < 0.5 ? [] : [{ name: t("north"), key: "N", path: "M10 2l3.6 8L10 18l-3.6-8zM6.4 10h7.2", turned: -bearing, act: onNorth }]),
    ...(imagery === undefined
      ? []
      : [{ name: t("imagery"), key: "b", path: "M3 4h14v12H3zM3 13l4-4 3.5 3.5L13 10l4 4M13 7.2v.1", pressed: imagery, stays: true as const, act: () => wishMap({ imagery: !imagery }) }]),
    ...(onMeasure === undefined ? [] : [{ name: t("measure"), key: "m", path: "M2.5 13.5l11-11 4 4-11 11zM6 10l2 2M9 7l2 2M12 4l2 2", pressed: measuring, stays: true as const, act: onMeasure }]),
    ...(onNetworked === undefined
      ? []
      : [{ name: t("networked"), key: "n", path: "M10 12.2a2.2 2.2 0 1 0 0-4.4 2.2 2.2 0 0 0 0 4.4M6 14a5.6 5.6 0 0 1 0-8M14 6a5.6 5.6 0 0 1 0 8M3.6 16.4a9 9 0 0 1 0-12.8M16.4 3.6a9 9 0 0 1 0 12.8", pressed: networked === true, stays: true as const, act: onNetworked }]),
  ];
  return [
    ...(table ? [] : map),
    ...(onTable === undefined ? [] : [{ name: t(table ? "asMap" : "asTable"), key: "x", path: "M3 4.5h14v11H3zM3 8.2h14M3 11.8h14M8 8.2v7.3", pressed: table, stays: true as const, act: onTable }]),
    ...(onWall === undefined ? [] : [{ name: t("wall"), key: "w", path: "M2.5 4h15v9.5h-15zM10 13.5V17M6.5 17h7", act: onWall }]),
  ];
}

/** What one can do with the map. */
export function ZoomControls(properties: Properties): ReactElement {
  const wishes = useMapWishes();
  const { base, elsewhere } = useBaseMap();
  const imagery = base.imagery === undefined ? undefined : wishes.imagery;
  // Where no building is known there is nothing to look at aslant.
  const deep = hasBuildings(base) && !elsewhere ? properties.deep : undefined;
  return (
    <div className="float zoom" role="group" aria-label={t("map")}>
      {tools({ ...properties, deep }, imagery).map(({ name, key, path, pressed, stays, turned, act }) => (
        <button
          key={key}
          type="button"
          className="icon-button"
          data-stays={stays}
          title={turned === undefined ? `${name} (${key})` : name}
          aria-label={name}
          aria-pressed={pressed}
          onClick={act}
        >
          <svg viewBox="0 0 20 20" aria-hidden="true">
            <path d={path} {...(turned !== undefined && { transform: `rotate(${Math.round(turned)} 10 10)` })} />
          </svg>
        </button>
      ))}
    </div>
  );
}
