import type { LayerSpecification } from "maplibre-gl";
import type { Palette } from "./icons";

/** Something more on the map (zones, areas): drawn over the base map and the metre grid, under pads and drones. */
export type Overlay = {
  /** Of its source; each of its layers names it. */
  id: string;
  /** In the colours of the theme that holds; called again when that changes. */
  layers: (colours: Palette) => LayerSpecification[];
  features: GeoJSON.Feature[];
};
