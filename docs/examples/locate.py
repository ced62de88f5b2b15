import asterism

# Five beacons under the ceiling of a hall, and the ranges that a tag has measured, to 5 cm [m].
beacons = [[0, 0, 4], [20, 0, 4], [20, 12, 4], [0, 12, 4], [10, 6, 4]]
fix = asterism.locate(beacons, [7.87, 16.12, 17.23, 9.92, 6.14], 0.05)
for place in fix.minima:
    print(f"{place.x.round(2)}, height +-{place.covariance[2, 2] ** 0.5:.2f}, weight {place.weight:.2f}")
print("proven" if fix.proven else "not proven", fix.message, sep="; ")
