"""The slow, obvious simulation: written from the paper and its readings alone, it judges the kernels.

It takes profiles and arenas as people write them (cm, degrees) and goes ray by ray, number by number.
"""
