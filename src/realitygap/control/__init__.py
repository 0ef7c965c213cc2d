"""§5.2, §5.3: genotype to network, encodings, operators on genotypes, controllers made by hand."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "encoding": "Encoding controller_of make_encoding",
    "genotype": "Genes Layout braitenberg constant from_text load_genotype save_genotype to_text",
    "network": "NetworkController decode",
    "operators": "Variation random_genotype",
})  # fmt: skip
