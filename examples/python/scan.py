"""Raw points to a picture:  scan.py POINTS OUT.png"""

import sys

import numpy as np
import surfelkit


def main(points: str, picture: str) -> None:
    cloud = surfelkit.read_points(points)
    print(cloud)
    surfels = surfelkit.estimate(cloud)
    # Surfels whose normal has no confidence at all are left out.
    trusted = surfels[surfels.columns["confidence"] > 0]
    print(f"{len(trusted)} of {len(surfels)} surfels have a normal, "
          f"{np.sqrt(np.median(trusted.columns['area'])):.3g} apart")
    surfelkit.write(picture, surfelkit.render(trusted, size=(640, 480), cutoff=2))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (surfelkit.Error, TypeError) as error:
        sys.exit(f"scan.py: error: {error}")
