/** What the server answers, by the address it is asked at. */
import type { paths } from "../../api/schema.gen";

export type Calibration =
  paths["/api/v1/calibrations"]["get"]["responses"]["200"]["content"]["application/json"][number];
export type Session =
  paths["/api/v1/calibrate/sessions"]["get"]["responses"]["200"]["content"]["application/json"][number];
export type Comparison =
  paths["/api/v1/calibrations/compare"]["get"]["responses"]["200"]["content"]["application/json"];
