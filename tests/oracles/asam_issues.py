"""Issues of road networks and scenarios, by ASAM's checkers; runs in environment ``asam``.

Reads JSON from standard input: a list of paths of ``.xodr`` and ``.xosc`` files. Writes for
each the number of checkers that completed and a list of issues, first those of the schema
that scenariogeneration brings, which are found apart from the checkers.
"""

import json
import sys
from pathlib import Path

import qc_opendrive.constants
import qc_opendrive.main
import qc_openscenario.constants
import qc_openscenario.main
import schemas
from lxml import etree
from qc_baselib import Configuration, Result, StatusType

CHECKERS = {
    ".xodr": (qc_opendrive, "opendrive_17_core.xsd"),
    ".xosc": (qc_openscenario, "OpenSCENARIO_1_2.xsd"),
}
SCHEMAS = Path(next(iter(schemas.__path__)))


def issues(path: Path) -> dict:
    """Issues of a file, as ``LEVEL rule: description``."""
    checker, schema = CHECKERS[path.suffix]
    schema = etree.XMLSchema(etree.parse(SCHEMAS / schema))
    schema.validate(etree.parse(path))
    found = [f"XSD line {one.line}: {one.message}" for one in schema.error_log]
    config, result = Configuration(), Result()
    config.set_config_param("InputFile", str(path))
    name = checker.constants.BUNDLE_NAME
    version = checker.constants.BUNDLE_VERSION
    result.register_checker_bundle(
        name=name, description="", version=version, summary=""
    )
    result.set_result_version(version=version)
    checker.main.run_checks(config, result)
    completed = 0
    for one in result.get_checker_results(name):
        completed += one.status == StatusType.COMPLETED
        if one.status == StatusType.ERROR:
            found.append(f"CRASH {one.checker_id}: {one.summary}")
        found += [
            f"{issue.level.name} {issue.rule_uid}: {issue.description}"
            for issue in one.issues
        ]
    return {"completed": completed, "issues": found}


if __name__ == "__main__":
    answers = [issues(Path(one)) for one in json.load(sys.stdin)]
    json.dump(answers, sys.stdout)
