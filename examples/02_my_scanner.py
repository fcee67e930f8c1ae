"""A scanner of your own as YAML: on which part of the floor does it fix the position?"""

from pathlib import Path

import ambinav as an

scanner = an.RangeScanner.from_yaml(Path(__file__).with_suffix(".yaml"))
environment = an.load_environment(an.DEMO_BUILDING)
print("ranges at the start:", scanner.scan(environment, 3.0, 3.0, 0.0).round(2))
amap = an.build_map(environment, scanner, spacing=0.4)  # with headings: it does not look all around
for zone in amap.zone_shares(mask=amap.judged.counted):
    print(f"{zone.zone}: {zone.share:.0%} of the judged floor, over all headings")
