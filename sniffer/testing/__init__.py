"""The conformance kit: ``check(protocol, talk)`` holds a protocol to the laws and to the truth.

A protocol that lives outside this package is tested with it (docs/conformance.md)::

    from sniffer.testing import Exchange, check

    result = check(PROTOCOL, [Exchange("ping", b"...", (b"...",), {}), ...])
    assert result.ok, result.report()

``checks`` gives the same one by one, for ``pytest.mark.parametrize("one", checks(...), ids=str)``.
"""

from sniffer.testing.kit import Report, Requirement, check, checks
from sniffer.testing.talk import Exchange, Label, Talk

__all__ = ["Exchange", "Label", "Report", "Requirement", "Talk", "check", "checks"]
