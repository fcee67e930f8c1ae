"""Where does this building leave this scanner lost? A report that opens in a browser."""

import ambinav as an
from ambinav.demo import BUILDING
from ambinav.studies.audit.audit import audit
from ambinav.studies.audit.report import write_report

environment = an.load_environment(BUILDING)  # or your office.yaml of map_server, a GeoJSON, a WKT
scanner = an.RangeScanner.from_preset("hokuyo-urg-04lx")
amap = an.build_map(environment, scanner, spacing=0.2)
found = audit(amap, environment, scanner, places=5)
print(found.summary)
write_report(found, "out/01-audit")
print("report: out/01-audit/report.html")
