"""Reads a JUnit XML file with a library of its own and says what is in it."""

import sys

from junitparser import JUnitXml

report = JUnitXml.fromfile(sys.argv[1])
cases = [case for suite in report for case in suite]
failed = [case for case in cases if not case.is_passed and not case.is_skipped]
assert report.tests == len(cases), (report.tests, len(cases))
assert report.failures + report.errors == len(failed), (report.failures, report.errors, failed)
assert all(case.result[0].message and case.result[0].type for case in failed), "a failure says why"
assert all(case.classname for case in cases), "runners group by class"
spent_s = sum(case.time for case in cases)
assert all(abs(part.time - spent_s) < 0.1 for part in [report, *report]), (report.time, spent_s)
print(f"{len(cases)} tests, {len(failed)} failure")
