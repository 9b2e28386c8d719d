/** Which job wrote which cloud as text: `scan/cloud` to the job's id, until the page is loaded again. */
export const exportJobs = $state<Record<string, string>>({});
