// What a user writes against the types that openapi-typescript makes of the contract.
import type { components, paths } from "./api";

type Schemas = components["schemas"];

export const modes: Schemas["ImpactModesRequest"] = {
  system: { preset: "chain", n: 13, constraints: [{ dof: 5, gap: 0.2 }] },
  frequency: { start: 1, stop: 2, num: 5 },
};
const driven: Schemas["PeriodicMotionsRequest"] = {
  system: { preset: "oscillator", Omega0: 1, zeta: 0.05, constraints: [{ dof: 0, gap: 1, restitution: 0.8 }] },
  load: [{ dof: 0, amplitude: 1 }],
  frequency: { values: [1] },
  sequence: "symmetric",
};
export const branches: Schemas["BranchesRequest"] = { base: driven, path: "frequency", start: 1, stop: 2 };

type Answer<Path extends keyof paths> = paths[Path] extends { post: { responses: { 200: { content: { "application/json": infer Content } } } } } ? Content : never;

export const admissible = (answer: Answer<"/v1/compute/impact-modes">): number => answer.frequency.Omega.length;
export const special = (answer: Answer<"/v1/compute/branches">): number => answer.points.length;
