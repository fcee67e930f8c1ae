"""Where does this building leave this scanner lost? A report that opens in a browser."""

import ambinav as an

environment = an.load_environment(
    an.DEMO_BUILDING
)  # or your office.yaml of map_server, a GeoJSON, a WKT
scanner = an.RangeScanner.from_preset("hokuyo-urg-04lx")
amap = an.build_map(environment, scanner, spacing=0.2)
found = an.audit(amap, environment, scanner, places=5)
print(found.summary)
an.write_audit(found, "out/01-audit")
print("report: out/01-audit/report.html")
