"""§5.2, §5.3: genotype to network, encodings, operators on genotypes, controllers made by hand."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "encoding": "Encoding controller_of make_encoding",
    "genotype": "from_text load_genotype random_genotype save_genotype to_text",
    "handmade": "braitenberg constant",
    "layout": "Genes Layout",
    "network": "NetworkController decode",
    "operators": "Variation",
})  # fmt: skip
