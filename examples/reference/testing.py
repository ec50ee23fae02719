"""Check that an agent keeps the contract."""

import mtp_bench
from mtp_bench import check_agent

findings = check_agent(
    mtp_bench.load_submission("stp").build,
    "MTP-Roundabout-v0",
    scenes=["roundabout-010000"],
)
print(
    {
        level: sum(finding.level == level for finding in findings)
        for level in ("ok", "warning", "error")
    }
)
print(findings[0])
