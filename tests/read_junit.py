"""Reads a JUnit XML file with a library of its own and says what is in it."""

import sys

from junitparser import JUnitXml

report = JUnitXml.fromfile(sys.argv[1])
cases = [case for suite in report for case in suite]
failed = [case for case in cases if not case.is_passed and not case.is_skipped]
assert report.tests == len(cases), (report.tests, len(cases))
assert report.failures + report.errors == len(failed), (report.failures, report.errors, failed)
assert all(case.result[0].message for case in failed), "a failure says why"
print(f"{len(cases)} tests, {len(failed)} failure")
