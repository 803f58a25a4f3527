"""Reads a certificate as others do, with PTB's own reader, and checks the order of its elements."""

import warnings

from dccXMLJSONConv.dccConv import XMLToJson

ORDER = {
    "digitalCalibrationCertificate": "administrativeData! measurementResults! comment document",
    "administrativeData": "dccSoftware! refTypeDefinitions coreData! items!"
    " calibrationLaboratory! respPersons! customer! statements",
    "software": "name! release! type description",
    "refTypeDefinition": "name! description namespace! link! release value procedure",
    "coreData": "countryCodeISO3166_1! usedLangCodeISO639_1! mandatoryLangCodeISO639_1!"
    " uniqueIdentifier! identifications receiptDate beginPerformanceDate! endPerformanceDate!"
    " performanceLocation! issueDate",
    "identification": "issuer! value! name",
    "item": "name! equipmentClass description owner installedSoftwares manufacturer model"
    " identifications! itemQuantities subItems",
    "calibrationLaboratory": "calibrationLaboratoryCode contact!",
    "respPerson": "person! description role mainSigner",
    "contact": "name! eMail phone fax link location!",
    "customer": "name! eMail phone fax link location!",
    "statement": "name description countryCodeISO3166_1 convention traceable norm reference link"
    " declaration valid date period respAuthority conformity data",
    "measurementResult": "name! description usedMethods usedSoftware measuringEquipments"
    " influenceConditions results! measurementMetaData",
    "usedMethod": "name! description norm reference link usedMethodQuantities",
    "measuringEquipment": "name! equipmentClass description certificate manufacturer model"
    " identifications measuringEquipmentQuantities",
    "influenceCondition": "name! description status certificate data!",
    "result": "name! description data!",
    "real": "label quantityType value! unit! significantDigit dateTime"
    " measurementUncertaintyUnivariate",
    "expandedMU": "valueExpandedMU! coverageFactor! coverageProbability! distribution",
    "realListXMLList": "labelXMLList quantityTypeXMLList valueXMLList! unitXMLList!"
    " significantDigitXMLList dateTimeXMLList measurementUncertaintyUnivariateXMLList",
    "expandedMUXMLList": "valueExpandedMUXMLList! coverageFactorXMLList!"
    " coverageProbabilityXMLList! distributionXMLList",
}
"""Element of the DCC 3.3.0 and of D-SI 2.2.1 → what it may contain, in order; !: it must."""


def local(element):
    """Return the name of an element without its namespace."""
    return element.tag.rpartition("}")[2]


def disorder(root):
    """Yield the elements that contain what they may not, in another order, or too little."""
    for element in root.iter():
        rule = ORDER.get(local(element))
        if rule is None:
            continue
        allowed = [name.rstrip("!") for name in rule.split()]
        found = [local(child) for child in element]
        places = [allowed.index(name) if name in allowed else -1 for name in found]
        needed = {name.rstrip("!") for name in rule.split() if name.endswith("!")}
        if places != sorted(places) or -1 in places or not needed <= set(found):
            yield local(element), found


class ReadCertificate:
    """A certificate as PTB's reader returns it.

    Args:
        text: the XML.
    """

    def __init__(self, text):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read = XMLToJson(text)["dcc:digitalCalibrationCertificate"]
        self.administration = read["dcc:administrativeData"]
        self.measurement = read["dcc:measurementResults"]["dcc:measurementResult"]
        self.quantities = {}
        for result in listed(self.measurement["dcc:results"]["dcc:result"]):
            for quantity in listed(result["dcc:data"]["dcc:list"]["dcc:quantity"]):
                name = quantity["@refType"].split()[-1]
                # Nominal values of each result have the same name.
                self.quantities[(result["@refType"], name)] = quantity
                self.quantities.setdefault(name, quantity)

    def statements(self):
        """Return the statements by their refType."""
        return {
            one["@refType"]: one
            for one in listed(self.administration["dcc:statements"]["dcc:statement"])
        }

    def identifications(self):
        """Return the identifiers of the certificate by their refType."""
        found = self.administration["dcc:coreData"]["dcc:identifications"]["dcc:identification"]
        return {one["@refType"]: text(one["dcc:value"]) for one in listed(found)}

    def conditions(self):
        """Return the influence conditions by their refType."""
        found = self.measurement["dcc:influenceConditions"]["dcc:influenceCondition"]
        return {one["@refType"]: one["dcc:data"] for one in listed(found)}


def text(node):
    """Return the text of a node."""
    return node["#text"]


def listed(node):
    """Return a list, of one if it is none."""
    return node if isinstance(node, list) else [node]


def values_of(quantity):
    """Return values, unit, U, k and probability of a quantity, each value with its own."""
    if "si:real" in quantity:
        real = quantity["si:real"]
        wide = real["si:measurementUncertaintyUnivariate"]["si:expandedMU"]
        kinds = ("valueExpandedMU", "coverageFactor", "coverageProbability")
        numbers = [[float(text(wide[f"si:{kind}"]))] for kind in kinds]
        return [float(text(real["si:value"]))], text(real["si:unit"]), *numbers
    reals = quantity["si:realListXMLList"]
    values = _numbers(reals["si:valueXMLList"])
    wide = reals["si:measurementUncertaintyUnivariateXMLList"]["si:expandedMUXMLList"]
    numbers = []
    for kind in ("valueExpandedMU", "coverageFactor", "coverageProbability"):
        found = _numbers(wide[f"si:{kind}XMLList"])
        # D-SI: one entry stands for all values, otherwise each value has one.
        assert len(found) in (1, len(values))
        numbers.append(found * len(values) if len(found) == 1 else found)
    return values, text(reals["si:unitXMLList"]), *numbers


def positions_of(quantity):
    """Return the values of a list without uncertainty."""
    return _numbers(quantity["si:realListXMLList"]["si:valueXMLList"])


def _numbers(node):
    return [float(one) for one in text(node).split(" ")]
