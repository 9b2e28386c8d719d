/** Addresses of what can be saved of a calibration, and of its pictures. */
import { API } from "../../api/addresses";

const calibration = (name: string) => `${API}/calibrations/${encodeURIComponent(name)}`;

export const calibrationFile = (name: string) => `${calibration(name)}/calibration.json`;
export const opencvFile = (name: string) => `${calibration(name)}/opencv.yml`;
export const reportPage = (name: string) => `${calibration(name)}/report.html`;
export const viewPicture = (jobId: string, number: number) =>
  `${API}/calibrate/${encodeURIComponent(jobId)}/views/${number}.jpg`;
