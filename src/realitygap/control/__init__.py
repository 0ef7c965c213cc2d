"""§5.2, §5.3: genotype to network, encodings, operators on genotypes, controllers made by hand."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "encoding": "Encoding Variation make_encoding",
    "genotype": "Genotype NetworkController",
    "slots": "Genes decode",
})  # fmt: skip
