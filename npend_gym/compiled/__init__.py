"""How Python becomes machine code: decorators, packs of numbers, sine and cosine.

No physics. jit holds the decorators, packs the numbers of many lanes.
"""
