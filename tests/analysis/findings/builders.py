"""Findings for tests."""

from pd_editor.analysis.findings.finding import Finding, FindingKind


def finding(
    kind: FindingKind, name: str, first: int = 60, last: int = 70, **values
) -> Finding:
    """A finding of one agent between two steps."""
    return Finding(
        **{
            "kind": kind,
            "agent_ids": (name,),
            "spans": ((first, last),),
            "worst_step": (first + last) // 2,
            "value": 1.0,
            "limit": 1.0,
            "headline": f"{name} {kind}",
            "message": "",
            "place_m": (0.0, 0.0),
            **values,
        }
    )
