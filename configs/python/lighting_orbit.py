"""One orbit of the Space Station: the Sun rises, crosses the sky and sets behind the Earth, for a Node with
three arrays of targets before it. A run takes the stated moment; the sweep takes the whole orbit and says
for each array how long it is in each condition of Table 1:

scanner-sim orbit configs/lighting_orbit.yaml

The scanner looks backwards along the orbit: the Sun rises behind it, passes over it and sets before it.

The same in YAML: ``configs/lighting_orbit.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 18,
        "scanner": {"preset": "nrc_2000"},
        "scene": {
            "objects": [
                {
                    "name": "module",
                    "file": CONFIGS / "../scenes/node_z1.xml",
                    "position": ["0 m", "1.4 m", "9.2 m"],
                },
                {
                    "name": "hatch",
                    "array": {
                        "diameter": "100 mm",
                        "plate": "180 mm",
                        "rows": 2,
                        "columns": 2,
                        "spacing": ["400 mm", "400 mm"],
                    },
                    "position": ["0 m", "1.4 m", "9.47 m"],
                },
                {
                    "name": "under_truss",
                    "array": {
                        "diameter": "100 mm",
                        "plate": "180 mm",
                        "rows": 1,
                        "columns": 4,
                        "spacing": ["400 mm", "400 mm"],
                    },
                    "position": ["0 m", "-1.45 m", "11.4 m"],
                },
                {
                    "name": "free",
                    "array": {
                        "diameter": "100 mm",
                        "plate": "180 mm",
                        "rows": 2,
                        "columns": 1,
                        "spacing": ["400 mm", "400 mm"],
                    },
                    "position": ["-2.2 m", "-0.9 m", "8 m"],
                    "rotation": {"axis": "y", "angle": "-30 deg"},
                },
            ]
        },
        "lighting": {
            "orbit": {
                "altitude": "400 km",
                "inclination": "51.6 deg",
                "beta": "15 deg",
                "anomaly": "-60 deg",
                "attitude": {"forward": "wake", "down": "nadir"},
            }
        },
        "scan": {
            "type": "raster",
            "rows": 128,
            "columns": 160,
            "horizontal": ["-17 deg", "17 deg"],
            "vertical": ["-14 deg", "14 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
